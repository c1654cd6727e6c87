"""The endpoint file of a run's own processes."""

from __future__ import annotations

from pathlib import Path

import msgspec

from cli.toml_text import toml_keys, toml_text
from schemas.endpoints import Endpoints

ENDPOINTS = "endpoints.toml"


def write_endpoints(path: Path, endpoints: Endpoints) -> None:
    """Writes endpoints without certificates, such that they read back the same.

    Args:
        path: of the TOML.
        endpoints: what to write; paths of certificates would be relative to the file.
    """
    keys = msgspec.to_builtins(endpoints)
    access = keys.pop("access")
    if keys.pop("tls") is not None:
        raise ValueError("endpoints: got certificates, expected none to be copied")
    text = toml_keys(keys) + "\n\n" + toml_text({"access": access})
    path.write_text(text, encoding="utf-8")
