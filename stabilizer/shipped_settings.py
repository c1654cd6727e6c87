"""Controller settings that ship with the package, found by name."""

from __future__ import annotations

from pathlib import Path

from schemas.errors import FileFormatError

PRESETS_DIR = Path(__file__).parent / "presets"


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
