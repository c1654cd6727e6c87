"""Controllers to compare, each with its settings, by one name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cli.errors import UsageError
from cli.run_plan import load_settings
from schemas.settings import ControllerSettings
from stabilizer.factory import CONTROLLERS


@dataclass(frozen=True)
class Variant:
    """A controller with settings.

    Attributes:
        name: as in tables and plots.
        controller: of the command line.
        settings: name or path of a settings file, if any.
        settings_of: other settings files by the servo profile they were made for.
        overrides: texts ``section.name=value``.
        about: what it gets, in words.
    """

    name: str
    controller: str
    settings: str | None = None
    settings_of: Mapping[str, str] = field(default_factory=dict)
    overrides: tuple[str, ...] = ()
    about: str = ""

    def resolve(
        self, servo_profile: str, *, extra: tuple[str, ...] = ()
    ) -> ControllerSettings:
        """All of its settings.

        Args:
            servo_profile: of the robot it will command.
            extra: further texts ``section.name=value``.

        Raises:
            FileFormatError: a file or an override is malformed.
        """
        name = self.settings_of.get(servo_profile, self.settings)
        file = None if name is None else Path(name)
        return load_settings(file, overrides=[*self.overrides, *extra])


_KNOWN = (
    Variant("whole-body", "whole-body", about="default settings"),
    Variant(
        "paper",
        "whole-body",
        overrides=("whole_body.preset=paper",),
        about="the published law alone: nothing fed forward",
    ),
    Variant(
        "zmp-tuned",
        "zmp",
        "zmp-tuned",
        {"harmonic": "zmp-tuned-harmonic"},
        about="best of a search on other scenarios, one for each servo profile",
    ),
    Variant("zmp-stock", "zmp", "zmp-stock", about="published gains and clamps"),
)
VARIANTS = {variant.name: variant for variant in _KNOWN}


def find_variant(name: str) -> Variant:
    """A variant by its name, or a controller with default settings.

    Raises:
        UsageError: no such variant; the message lists all.
    """
    if name in VARIANTS:
        return VARIANTS[name]
    if name in CONTROLLERS:
        return Variant(name, name, about="default settings")
    names = dict.fromkeys([*VARIANTS, *CONTROLLERS])
    raise UsageError(f"no controller {name!r}; expected one of {', '.join(names)}")
