"""A signal while libraries load ends the command with 130 and a message."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tests.command import run_python

INTERRUPTED = 130
SCRIPT = """
import os, signal, sys, types
import surefoot.cli.__main__ as entry

def app(prog_name):
    try:
        # As a text, as dataclasses are made: Python keeps that in mind.
        exec("os.kill(os.getpid(), signal.{name})\\nwhile True: pass")
    except KeyboardInterrupt as error:
        raise {error} from error

sys.modules["surefoot.cli.app"] = types.SimpleNamespace(app=app)
entry.main()
"""


@pytest.mark.parametrize(
    "error", ["ImportError('numpy')", "RuntimeError('odd')", "error"]
)
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_library_that_turns_it_into_its_own_error(
    tmp_path: Path, name: str, error: str
) -> None:
    assert hasattr(signal, name)
    script = SCRIPT.format(name=name, error=error)
    (tmp_path / "interrupted.py").write_text(script)
    done = run_python("-m", "interrupted", cwd=tmp_path)
    assert done.returncode == INTERRUPTED, done.stderr
    assert done.stderr == f"surefoot: interrupted by {name}\n"
