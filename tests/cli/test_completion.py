"""Shell completion, asked as bash asks it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import Surefoot, run_python


def asked(line: str) -> dict[str, str]:
    """Return the variables by which bash asks for the end of a line."""
    return {
        "_SUREFOOT_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(line.split(" ")) - 1),
    }


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("surefoot ech", ["echo"]),
        ("surefoot run moving-platform-", ["moving-platform-fast",
                                           "moving-platform-slow"]),
        ("surefoot run sub/mi", ["sub/mine.toml"]),
        ("surefoot echo left_", ["left_ankle_ft"]),
        ("surefoot hz joints im", ["imu"]),
        ("surefoot run standing --robot walker-", ["walker-real"]),
        ("surefoot run standing --controller zm", ["zmp"]),
        ("surefoot run standing --set ground.ga", ["ground.gain="]),
    ],
)  # fmt: skip
def test_names_are_completed(
    tmp_path: Path,
    surefoot_here: Surefoot,
    monkeypatch: pytest.MonkeyPatch,
    line: str,
    expected: list[str],
) -> None:
    (folder := tmp_path / "work" / "sub").mkdir()
    (folder / "mine.toml").touch()
    (folder / "mine.txt").touch()
    for name, value in asked(line).items():
        monkeypatch.setenv(name, value)
    done = surefoot_here()
    assert done.stderr == ""
    assert done.stdout.split() == expected


def test_the_command_answers_bash() -> None:
    done = run_python("-m", "surefoot.cli", **asked("surefoot ech"))
    assert (done.stdout.split(), done.stderr) == (["echo"], "")


def test_the_shell_can_be_told(
    surefoot: Surefoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked by name: whoever started the tests need not be a shell."""
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    done = surefoot("--show-completion", "bash")
    assert done.returncode == 0, done.stderr
    assert "_SUREFOOT_COMPLETE=complete_bash" in done.stdout
