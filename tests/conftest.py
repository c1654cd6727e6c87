"""Fixtures of all tests: a bus of their own, the command, a short scenario."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from surefoot.cli import console
from surefoot.cli.__main__ import main
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.robot import ROBOTS_DIR
from surefoot.schemas.endpoints import Endpoints, write_endpoints
from tests.command import PLAIN, Surefoot, run_surefoot, scenario_file
from tests.one_name import modules_with_two_names
from tests.patient_robot import patient_robot_file
from tests.robot_io.meeting_places import meeting_place

settings.register_profile(
    "patient", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("patient")
TESTS = Path(__file__).parent
OF_PROCESSES = (
    *("cli/", "nodes/", "deploy/", "docs/", "examples/", "files/"),
    *("robot_io/conformance/", "surefoot/playback/", "surefoot/report/"),
    *("surefoot/test_import_names.py", "robot_io/test_private_bus.py"),
    *("surefoot/test_library.py", "surefoot/test_out_folder.py"),
)
"""Folders and files whose tests start processes."""
FIXTURES_OF_PROCESSES = {
    *("endpoints", "endpoint_file", "surefoot", "authority", "meeting", "routed"),
}
"""Fixtures that use a bus or start a process."""


@pytest.fixture
def endpoints() -> Endpoints:
    """Return the endpoints of a bus on this host that no other test uses."""
    return loopback_endpoints()


@pytest.fixture
def routed() -> Iterator[Endpoints]:
    """Return the endpoints of such a bus with a router."""
    with meeting_place(routed=True) as endpoints:
        yield endpoints


@pytest.fixture
def endpoint_file(tmp_path: Path, endpoints: Endpoints) -> Path:
    """Return an endpoint file for commands on a bus of this test's own.

    With only ``--listen`` and ``--connect``, two processes part after half a second of
    silence, which a busy machine may cause.
    """
    path = tmp_path / "endpoints.toml"
    write_endpoints(path, endpoints)
    return path


@pytest.fixture
def surefoot_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Surefoot:
    """Run a command of ``surefoot`` in this process, in an empty folder.

    Most of a short command's time is its start, and a hundred processes would take
    minutes. Only for commands that end by themselves and start no others.
    """
    work = tmp_path / "work"
    work.mkdir(exist_ok=True)

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        words = ["surefoot", *map(str, arguments)]
        code: object = 0
        handler = signal.getsignal(signal.SIGTERM)
        with monkeypatch.context() as patch:
            patch.chdir(work)
            patch.setattr(sys, "argv", words)
            for name, value in PLAIN.items():
                patch.setenv(name, value)
            # Made when first imported, maybe by a test with a narrower terminal.
            patch.setattr(console, "_stdout", console._console_for_results())
            capfd.readouterr()
            try:
                main()
            except SystemExit as end:
                code = 0 if end.code is None else end.code
            except Exception:
                traceback.print_exc()
                code = 1
            finally:
                signal.signal(signal.SIGTERM, handler)
            out, err = capfd.readouterr()
        assert isinstance(code, int)
        return subprocess.CompletedProcess(words, code, out, err)

    return run


@pytest.fixture
def surefoot(tmp_path: Path, surefoot_here: Surefoot) -> Surefoot:
    """Run a command of ``surefoot`` in an empty folder, as a process of its own.

    With ``--inline`` it runs in this process, since it starts no others.
    """
    work = tmp_path / "work"

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        if "--inline" in arguments:
            return surefoot_here(*arguments)
        return run_surefoot(*arguments, cwd=work)

    return run


@pytest.fixture
def short_scenario(tmp_path: Path) -> Path:
    """Return a scenario: standing on firm ground for a fraction of a second."""
    noise = "[sensors]\nforce_noise_n = 2.0\n"
    return scenario_file(tmp_path, 0.3, name="short", more=noise)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Copy the Walker's files, to be damaged; return the path of its TOML."""
    for kind in ("urdf", "toml"):
        shutil.copy(ROBOTS_DIR / "walker" / f"walker.{kind}", tmp_path)
    return tmp_path / "walker.toml"


@pytest.fixture
def patient_walker(tmp_path: Path) -> Path:
    """Return a robot file of the Walker that waits long for its commander."""
    return patient_robot_file(tmp_path)


@pytest.fixture(scope="session", autouse=True)
def one_name_for_each_module() -> Iterator[None]:
    """Check that no test loads a module of ours under a second name."""
    yield
    assert modules_with_two_names() == {}


def needs_process(item: pytest.Item) -> bool:
    """Return whether one of a test's fixtures leads to a bus or a process."""
    fixtures = getattr(item, "fixturenames", ())
    return not FIXTURES_OF_PROCESSES.isdisjoint(fixtures)


def check_usual_cases(items: list[pytest.Item]) -> None:
    """Check that each usual case exists; else all cases of its test would be slow."""
    left: dict[str, set[str]] = {}
    for item in items:
        usual = item.get_closest_marker("usual")
        if usual is not None:
            cases = left.setdefault(item.nodeid.partition("[")[0], set(usual.args))
            cases.discard(item.callspec.id if hasattr(item, "callspec") else "")
    wrong = {test: cases for test, cases in left.items() if cases}
    if wrong:
        raise pytest.UsageError(f"usual cases that are not there: {wrong}")


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Mark tests that use a bus, processes or a browser, by their place.

    All others take a minute: ``-m "not (closed_loop or process or browser)"``. In a
    test with usual cases, the other cases are slow.
    """
    if not any("::" in word for word in config.args):
        check_usual_cases(items)
    for item in items:
        usual = item.get_closest_marker("usual")
        case = getattr(item, "callspec", None)
        if usual is not None and case is not None and case.id not in usual.args:
            item.add_marker(pytest.mark.slow)
        place = item.path.relative_to(TESTS).as_posix()
        if place.startswith("browser/"):
            item.add_marker(pytest.mark.browser)
        elif place.startswith(OF_PROCESSES) or needs_process(item):
            item.add_marker(pytest.mark.process)


def pytest_configure() -> None:
    """Make sure that Ctrl-C reaches the processes under test.

    A shell starts background jobs with SIGINT ignored, and children inherit that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report the tests that are left out."""
    left_out = [
        item
        for item in terminalreporter.stats.get("deselected", [])
        if item.get_closest_marker("slow") is not None
    ]
    if left_out:
        terminalreporter.write_line(
            f"{len(left_out)} slow tests left out; run them with: pytest -m slow"
        )
