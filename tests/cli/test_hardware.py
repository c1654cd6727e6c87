"""From simulator to hardware only robot file and endpoint file change."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from surefoot.robot_io.security.certificates import make_certificates
from tests.cli.conftest import Start
from tests.command import Surefoot
from tests.support import PATIENCE_S, free_port

TICKS = 800
SHORT = f"""
name = "short and rocking"
duration_s = {TICKS}e-3
[[platform]]
foot = "both"
  [[platform.motion]]
  axis = "roll"
  kind = "sine"
  amplitude_deg = 4.0
  frequency_hz = 0.7
[sensors]
force_noise_n = 2.0
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "rocking.toml"
    path.write_text(SHORT)
    return path


def secured(folder: Path, *, router: bool = False) -> Callable[..., Path]:
    """Make certificates; return a function that writes an identity's endpoint file."""
    make_certificates(folder / "certs", hosts=[], days=1)
    place = f"tls/127.0.0.1:{free_port()}"

    def endpoint_file(identity: str, locator: str = place) -> Path:
        path = folder / f"{identity}-{locator.rpartition(':')[2]}.toml"
        lines = [f'listen = ["{locator}"]', f'connect = ["{locator}"]']
        if router:
            lines += [f'router = ["{locator}"]']
        lines += [
            "[tls]",
            'ca = "certs/ca.pem"',
            f'certificate = "certs/{identity}.pem"',
            f'key = "certs/{identity}.key.pem"',
        ]
        path.write_text("\n".join(lines))
        return path

    return endpoint_file


def run_both(start: Start, robot_argv: list, stabilizer_argv: list) -> dict:
    """Run both sides, which must end well; return the plant's result."""
    robot = start("robot", "--json", *robot_argv)
    stabilizer = start("stabilizer", *stabilizer_argv)
    out, _ = robot.communicate(timeout=PATIENCE_S)
    stabilizer.communicate(timeout=PATIENCE_S)
    assert (robot.returncode, stabilizer.returncode) == (0, 0)
    plant: dict = json.loads(out)
    return plant


def test_the_real_keys_over_tls_are_the_same_run(
    start: Start, surefoot_here: Surefoot, scenario: Path, tmp_path: Path
) -> None:
    simulated = json.loads(surefoot_here("run", scenario, "--inline", "--json").stdout)
    file = secured(tmp_path)
    hardware = run_both(
        start,
        [scenario, "--robot", "walker-real", "--endpoints", file("robot")],
        ["--robot", "walker-real", "--endpoints", file("stabilizer")],
    )
    assert not hardware["fell"]
    assert hardware["fell"] == simulated["fell"]
    assert hardware["log_sha256"] == simulated["log_sha256"]
    assert hardware["ticks"] == TICKS


def test_robot_and_stabilizer_meet_at_a_router(
    start: Start, scenario: Path, tmp_path: Path
) -> None:
    file = secured(tmp_path, router=True)
    router = start("router", "--endpoints", file("router"))
    run = run_both(
        start,
        [scenario, "--endpoints", file("robot")],
        ["--controller", "hold", "--endpoints", file("stabilizer")],
    )
    assert run["ticks"] == TICKS
    assert run["deadline_misses"] == 0
    router.terminate()
    router.communicate(timeout=PATIENCE_S)
    assert router.returncode == 130


def test_a_relay_over_tls_dials_as_the_stabilizer_and_listens_as_the_robot(
    start: Start, scenario: Path, tmp_path: Path
) -> None:
    file = secured(tmp_path)
    beside = f"tls/127.0.0.1:{free_port()}"
    robot = start("robot", "--json", scenario, "--endpoints", file("robot"))
    between = ["--endpoints", file("stabilizer")]
    between += ["--listen-endpoints", file("robot", beside)]
    relay = start("relay", "clear", "--wait", PATIENCE_S, "--json", *between)
    stabilizer = start(
        *("stabilizer", "--controller", "hold"),
        *("--endpoints", file("stabilizer", beside)),
    )
    out, _ = robot.communicate(timeout=PATIENCE_S)
    stabilizer.communicate(timeout=PATIENCE_S)
    assert (robot.returncode, stabilizer.returncode) == (0, 0)
    assert json.loads(out)["ticks"] == TICKS
    relay.terminate()
    told, _ = relay.communicate(timeout=PATIENCE_S)
    assert relay.returncode == 130
    assert json.loads(told)["counts"]["joint_command"]["left"] > 0
