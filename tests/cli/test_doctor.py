from __future__ import annotations

import json
import socket
from importlib.metadata import version
from pathlib import Path

import pytest

from surefoot.cli.doctor_machine import check_port
from surefoot.cli.doctor_packages import (
    PINS,
    Severity,
    read_pins,
    required_packages,
)
from surefoot.schemas.endpoints import DEFAULT_LOCATOR
from tests.command import Surefoot, run_surefoot

LOOKED_AT = {
    "Python",
    "packages",
    "extra view",
    "extra parquet",
    "extra tune",
    "extra cluster",
    "MessagePack",
    "processors",
    "clock",
    "real-time priority",
    "linear algebra",
    "Zenoh on loopback",
    "port",
    "disk",
    "temporary files",
    "pictures (OpenGL)",
    "browser",
}


def test_everything_is_looked_at_and_bad_things_come_with_advice(
    surefoot: Surefoot,
) -> None:
    done = surefoot("doctor", "--json")
    told = json.loads(done.stdout)
    names = {entry["name"] for entry in told}
    assert names >= LOOKED_AT
    assert all(bool(e["advice"]) == (e["verdict"] != "ok") for e in told)
    # What runs these tests can run robots.
    assert done.returncode == 0, told
    assert not [e for e in told if e["verdict"] == "FAIL"]
    by_name = {entry["name"]: entry["got"] for entry in told}
    assert f"eclipse-zenoh {version('eclipse-zenoh')}" in by_name["packages"]
    assert "1 thread" in by_name["linear algebra"]
    assert "round trip median" in by_name["Zenoh on loopback"]


def test_what_would_stop_a_run_is_exit_code_3(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    """Modules beside us that cannot be imported stand in for broken packages.

    A missing library of the system is told from a missing package.
    """
    missing = "libgomp.so.1: cannot open shared object file: No such file or directory"
    work = tmp_path / "work"
    for name, reason in (("threadpoolctl", "broken"), ("pinocchio", missing)):
        (work / f"{name}.py").write_text(f"raise ImportError({reason!r})")
    done = surefoot("doctor")
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    lines = done.stdout.splitlines()
    for line, advice in (
        ("FAIL  linear algebra: broken", "pip install"),
        (f"FAIL  margins: {missing}", "apt-get install libgomp1"),
    ):
        assert advice in lines[lines.index(line) + 1]
    assert lines[-1].startswith("2 would stop a run")
    # The others are still looked at.
    assert any("Zenoh on loopback" in line for line in lines)
    run = run_surefoot("run", "standing", "--inline", cwd=work)
    assert run.returncode == 3
    assert "Traceback" not in run.stderr
    assert f"{missing}; a library of the system is missing" in run.stderr


def test_our_own_pins_name_every_package_we_need() -> None:
    pins = read_pins(PINS)
    assert pins
    for name in required_packages():
        assert name.lower() in pins, name


def test_a_port_in_use_is_a_warning() -> None:
    host, port = DEFAULT_LOCATOR.removeprefix("tcp/").split(":")
    try:
        server = socket.create_server((host, int(port)))
    except OSError:
        pytest.skip(f"{host}:{port} is taken by something else already")
    with server:
        found = check_port()
    assert found.verdict is Severity.WARN
    assert "in use" in found.got
    assert check_port().verdict is Severity.OK


def test_variables_that_keep_libraries_from_starting_would_stop_a_run(
    surefoot: Surefoot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "elg")
    monkeypatch.setenv("ZENOH_RUNTIME", "two threads")
    done = surefoot("doctor", "--json")
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    told = {entry["name"]: entry for entry in json.loads(done.stdout)}
    for name, variable in (
        ("pictures (OpenGL)", "MUJOCO_GL"),
        ("Zenoh on loopback", "ZENOH_RUNTIME"),
    ):
        assert told[name]["verdict"] == "FAIL"
        assert variable in told[name]["got"]
    # A process of its own: in this one, MuJoCo may be loaded already.
    run = run_surefoot("run", "standing", "--inline", cwd=tmp_path)
    assert run.returncode == 3
    assert "Traceback" not in run.stderr
    assert "MUJOCO_GL=elg" in run.stderr
