"""Runs with a relay between robot and stabilizer, in separate processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path

import msgspec
import pytest

from surefoot.robot_io.security.certificates import make_certificates
from surefoot.schemas.relay_plan import load_relay_plan
from surefoot.schemas.result import RunResult
from tests.command import REPOSITORY, Surefoot, command, environment, scenario_file
from tests.support import PATIENCE_S, wait_until

SERVICES_ONLY = """
name = "services and commands late"
[[fault]]
kind = "delay"
topics = ["mode", "lease", "joint_command"]
ms = 3.0
[[fault]]
kind = "duplicate"
topics = ["status"]
probability = 1.0
"""


def test_a_run_by_way_of_a_relay_tells_what_it_did(
    surefoot: Surefoot, short_scenario: Path, patient_walker: Path, tmp_path: Path
) -> None:
    plan, out = tmp_path / "late.toml", tmp_path / "out"
    plan.write_text(SERVICES_ONLY)
    done = surefoot(
        *("run", short_scenario, "--realtime", "--controller", "hold", "--json"),
        *("--robot", patient_walker, "--relay", plan, "--out", out),
    )
    assert done.returncode == 0, done.stderr
    result = msgspec.json.decode(done.stdout, type=RunResult)
    assert not result.fell
    assert result.relay is not None
    assert result.relay.plan == "services and commands late"
    commands = result.relay.counts["joint_command"]
    assert commands["delay"] == commands["arrived"] > 0
    assert result.round_trip_ms.median > 3.0
    status = result.relay.counts["status"]
    assert status["left"] == status["arrived"] + status["duplicate"]
    assert json.loads((out / "run.json").read_text())["relay"] == "late"
    assert load_relay_plan(out / "relay.toml").name == result.relay.plan
    assert "the stabilizer of walker may dial" in (out / "relay.log").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--relay", "loss-5"], "--relay needs --realtime"),
        (["--relay", "loss5", "--realtime"], "did you mean 'loss-5'?"),
        (["--relay", "gone.toml", "--realtime"], "gone.toml: no such relay plan"),
    ],
)
def test_what_cannot_be_relayed_is_said_before_anything_starts(
    surefoot_here: Surefoot, arguments: list[str], words: str
) -> None:
    done = surefoot_here("run", "standing", *arguments)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_relay_that_would_dial_itself_is_refused(surefoot_here: Surefoot) -> None:
    here = "tcp/127.0.0.1:7447"
    done = surefoot_here("relay", "clear", "--listen", here, "--connect", here)
    assert done.returncode == 2, done.stderr
    assert "would dial itself" in done.stderr


def test_a_relay_that_dies_is_named_as_the_one_who_failed(
    tmp_path: Path,
) -> None:
    scenario, out = scenario_file(tmp_path, 600.0), tmp_path / "out"
    words = ["run", str(scenario), "--realtime", "--controller", "hold"]
    run = subprocess.Popen(
        command(*words, "--relay", "clear", "--out", out),
        env=environment(),
        cwd=REPOSITORY,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        log = wait_until(
            lambda: next(
                (p for p in tmp_path.rglob("relay.log") if "may dial" in p.read_text()),
                None,
            ),
            what="the relay to be ready",
        )
        first = log.read_text().splitlines()[0]
        os.kill(int(first.rsplit(" ", 1)[-1]), signal.SIGKILL)
        _, stderr = run.communicate(timeout=PATIENCE_S)
    finally:
        run.kill()
        run.wait()
    assert run.returncode == 1, stderr
    assert "relay: was ended by signal 9" in stderr


def test_with_tls_a_relay_asks_for_the_file_it_listens_with(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    make_certificates(tmp_path / "certs", hosts=[], days=1)
    dials = tmp_path / "stabilizer.toml"
    dials.write_text(
        'connect = ["tls/127.0.0.1:7447"]\n[tls]\nca = "certs/ca.pem"\n'
        'certificate = "certs/stabilizer.pem"\nkey = "certs/stabilizer.key.pem"\n'
    )
    done = surefoot_here("relay", "clear", "--endpoints", dials)
    assert done.returncode == 2, done.stderr
    assert "with [tls] a relay has two identities" in done.stderr
    assert "--listen-endpoints" in done.stderr
