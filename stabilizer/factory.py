"""Makes controllers by the name they have on the command line."""

from __future__ import annotations

from pathlib import Path

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.controller import Controller, HoldController
from surefoot.stabilizer.control.whole_body import WholeBodyController
from surefoot.stabilizer.zmp.controller import ZmpController

CONTROLLERS = (WholeBodyController.name, ZmpController.name, HoldController.name)
PRESETS_DIR = Path(__file__).parent / "presets"


def make_controller(
    name: str, robot: Robot, settings: ControllerSettings
) -> Controller:
    """Make a controller, ready to be started.

    Args:
        name: one of CONTROLLERS.
        robot: what its files say.
        settings: of all controllers.

    Raises:
        ValueError: there is no such controller.
    """
    if name == WholeBodyController.name:
        return WholeBodyController(robot, settings)
    if name == ZmpController.name:
        return ZmpController(robot, settings)
    if name == HoldController.name:
        return HoldController(robot.n_a)
    raise ValueError(
        f"controller: got {name!r}, expected one of {', '.join(CONTROLLERS)}"
    )


def shipped_settings() -> list[str]:
    """Names of all shipped settings."""
    return sorted(path.stem for path in PRESETS_DIR.glob("*.toml"))


def find_settings(name_or_path: Path) -> Path:
    """Path of a settings file.

    Args:
        name_or_path: a bare word is the name of shipped settings, unless a file
            here is called so.

    Raises:
        FileFormatError: there are no such settings.
    """
    is_name = name_or_path.name == str(name_or_path) and not name_or_path.suffix
    if not is_name or name_or_path.exists():
        return name_or_path
    shipped = PRESETS_DIR / f"{name_or_path}.toml"
    if not shipped.is_file():
        raise FileFormatError(
            f"{name_or_path}: no such settings; shipped are "
            f"{', '.join(shipped_settings())}; a file ends in .toml"
        )
    return shipped
