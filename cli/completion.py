"""What the shell offers when the tab key is pressed."""

from __future__ import annotations

from pathlib import Path

_SUFFIX = ".toml"


def complete_scenario(incomplete: str) -> list[str]:
    """Return shipped scenarios, and scenario files."""
    from surefoot.sim_robot.catalogue import list_scenarios

    names = [name for name in list_scenarios() if name.startswith(incomplete)]
    return names + _files(incomplete)


def complete_channel(incomplete: str) -> list[tuple[str, str]]:
    """Return the channels that can be listened to, with what they carry."""
    from surefoot.cli.bus.topics import PUBLISHED

    return [
        (entry.name, entry.description)
        for entry in PUBLISHED
        if entry.name.startswith(incomplete)
    ]


def complete_robot(incomplete: str) -> list[str]:
    """Return shipped robots, and robot files."""
    from surefoot.robot_io.robot import list_robots

    names = [name for name in list_robots() if name.startswith(incomplete)]
    return names + _files(incomplete)


def complete_controller(incomplete: str) -> list[str]:
    """Return shipped and installed controllers."""
    from surefoot.stabilizer.factory import controller_names

    return [name for name in controller_names() if name.startswith(incomplete)]


def complete_setting(incomplete: str) -> list[str]:
    """Return settings that ``--set`` knows, up to the equals sign."""
    from surefoot.schemas.settings import setting_names

    known = (f"{name}=" for name in setting_names())
    return [name for name in known if name.startswith(incomplete)]


def _files(incomplete: str) -> list[str]:
    """Return TOML files and folders that begin so; none of an unreadable folder."""
    folder = Path(incomplete) if incomplete.endswith("/") else Path(incomplete).parent
    prefix = "" if str(folder) == "." and not incomplete.startswith("./") else folder
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return []
    paths = [
        f"{Path(prefix, path.name)}{'/' if path.is_dir() else ''}"
        for path in found
        if path.is_dir() or path.suffix == _SUFFIX
    ]
    return [path for path in paths if path.startswith(incomplete)]
