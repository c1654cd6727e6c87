"""Advice to install names a command that fits the way this was installed."""

from __future__ import annotations

import json
import shlex
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from surefoot import installation

REPOSITORY = Path(__file__).parents[2]


class Package:
    """The metadata that pip leaves for an installed package."""

    requires = (
        "numpy>=2.0",
        'viser<2,>=1.1; extra == "view"',
        'plotly>=6.0; extra == "view"',
        'pyarrow>=17; extra == "parquet"',
    )

    def __init__(self, told: dict | None) -> None:
        self._told = told

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self._told is None else json.dumps(self._told)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> object:
    """Pretend an installation outside a checkout, with pip's metadata."""
    monkeypatch.setattr(installation, "_ROOT", tmp_path)

    def install(told: dict | None) -> list[str]:
        monkeypatch.setattr(installation, "distribution", lambda _: Package(told))
        words = shlex.split(installation.install_command("view"))
        assert words[1:4] == ["-m", "pip", "install"]
        assert Path(words[0]).resolve() == Path(sys.executable).resolve()
        return words[4:]

    return install


def test_a_checkout_is_installed_from_its_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(REPOSITORY)
    assert installation.install_command("view").endswith("install -e '.[view]'")
    assert installation.install_command().endswith("install -e .")
    monkeypatch.chdir(tmp_path)
    assert f"-e '{REPOSITORY}[view]'" in installation.install_command("view")


def test_what_came_from_elsewhere_is_had_from_there_again(
    installed: object, tmp_path: Path
) -> None:
    wheel = tmp_path / "surefoot-0.1.0-py3-none-any.whl"
    wheel.touch()
    told = {"url": wheel.as_uri(), "archive_info": {}}
    assert installed(told) == [f"{wheel}[view]"]  # type: ignore[operator]
    vcs = {"vcs": "git", "commit_id": "abc"}
    told = {"url": "https://example.org/surefoot.git", "vcs_info": vcs}
    assert installed(told) == [  # type: ignore[operator]
        "surefoot[view] @ git+https://example.org/surefoot.git@abc"
    ]


@pytest.mark.parametrize("told", [None, {"url": "file:///gone.whl"}])
def test_what_cannot_be_had_again_is_left_alone(
    told: dict | None, installed: object
) -> None:
    """It may be on no index; what it needs is."""
    needed = installed(told)  # type: ignore[operator]
    assert needed == ["viser<2,>=1.1", "plotly>=6.0"]


def test_without_any_trace_the_name_is_left(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def nothing(name: str) -> Package:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(installation, "_ROOT", tmp_path)
    monkeypatch.setattr(installation, "distribution", nothing)
    assert installation.install_command("view").endswith("install 'surefoot[view]'")
