"""Pages about many runs: one static file each that opens offline."""

from __future__ import annotations

import base64
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

STYLE = Path(__file__).parent / "page.css"
PACKAGES = ("surefoot", "mujoco", "pin", "piqp", "numpy", "scipy")


def render(template: Path, **values: Any) -> str:
    """Fill a template.

    Args:
        template: a Jinja file; it gets ``style``, ``made``, ``versions`` and ``python``
            besides.
        values: what it shows.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.from_string(template.read_text(encoding="utf-8")).render(
        style=Markup(STYLE.read_text(encoding="utf-8")),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        versions={name: version(name) for name in PACKAGES},
        python=platform.python_version(),
        **values,
    )


def inline_svg(svg: bytes) -> str:
    """Return a drawing as an address; its names clash with no other drawing's."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
