"""Every module has one name, since a module loaded twice has two copies of each class.

The packages are at the root and are linked into ``surefoot/``, so a module could be
found under two names.
"""

from __future__ import annotations

import json
import sys

import pytest

from tests.command import run_python
from tests.one_name import modules_with_two_names

EVERYTHING = """
import json, pkgutil, sys
from importlib import import_module
import surefoot
for found in pkgutil.walk_packages(surefoot.__path__, "surefoot."):
    if not found.name.endswith("__main__"):
        import_module(found.name)
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.factory import make_controller
from tests.one_name import modules_with_two_names
from tests.stabilizer.closed_loop import run_closed_loop
walker = load_robot("walker")
for name in ("whole-body", "zmp"):
    controller = make_controller(name, walker, ControllerSettings())
    run_closed_loop(walker, controller=controller, duration_s=0.01)
print(json.dumps([modules_with_two_names(), len(sys.modules)]))
"""


def test_all_packages_and_a_run_load_each_module_once() -> None:
    done = run_python("-c", EVERYTHING)
    assert done.returncode == 0, done.stderr
    twice, loaded = json.loads(done.stdout.splitlines()[-1])
    assert twice == {}
    assert loaded > 200


def test_a_second_name_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    import surefoot.schemas.validation as found

    monkeypatch.setitem(sys.modules, "schemas.validation", found)
    (names,) = modules_with_two_names().values()
    assert names == ["schemas.validation", "surefoot.schemas.validation"]
