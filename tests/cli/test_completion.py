"""Shell completion, asked as bash asks it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import Surefoot, run_python


def offered(folder: Path, line: str) -> list[str]:
    """Return the completions at the end of a line."""
    words = line.split(" ")
    done = run_python(
        *("-m", "surefoot.cli"),
        cwd=folder,
        _SUREFOOT_COMPLETE="complete_bash",
        COMP_WORDS=line,
        COMP_CWORD=str(len(words) - 1),
    )
    assert done.stderr == ""
    return done.stdout.split()


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
def test_names_are_completed(tmp_path: Path, line: str, expected: list[str]) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "mine.toml").touch()
    (tmp_path / "sub" / "mine.txt").touch()
    assert offered(tmp_path, line) == expected


def test_the_shell_can_be_told(
    surefoot: Surefoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked by name: whoever started the tests need not be a shell."""
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    done = surefoot("--show-completion", "bash")
    assert done.returncode == 0, done.stderr
    assert "_SUREFOOT_COMPLETE=complete_bash" in done.stdout
