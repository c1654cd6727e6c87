"""Controllers to compare, each with its settings, by one name."""

from __future__ import annotations

from dataclasses import dataclass

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
        overrides: texts ``section.name=value``.
        about: what it gets, in words.
    """

    name: str
    controller: str
    settings: str | None = None
    overrides: tuple[str, ...] = ()
    about: str = ""

    def resolve(self, extra: tuple[str, ...] = ()) -> ControllerSettings:
        """All of its settings.

        Raises:
            FileFormatError: a file or an override is malformed.
        """
        return load_settings(self.settings, overrides=[*self.overrides, *extra])


_KNOWN = (
    Variant("whole-body", "whole-body", about="default settings"),
    Variant(
        "paper",
        "whole-body",
        overrides=("whole_body.preset=paper",),
        about="the published law alone: nothing fed forward",
    ),
    Variant(
        "zmp-tuned", "zmp", "zmp-tuned", about="best of a search on other scenarios"
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
