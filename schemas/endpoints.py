"""Endpoint file: where a process meets the others on the network."""

from __future__ import annotations

from typing import Annotated

import msgspec

from schemas.toml_file import FileStruct

DEFAULT_LOCATOR = "tcp/127.0.0.1:7447"


class Endpoints(FileStruct, frozen=True, kw_only=True):
    """Zenoh locators. The robot listens, everyone else dials.

    A file holds both sides; each process uses its own: the robot ``listen``, the
    others ``connect``.
    """

    listen: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    connect: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    lease_ms: Annotated[int, msgspec.Meta(ge=50, le=60000)] = 500
    """A peer silent for so long is gone."""
    retry_ms: Annotated[int, msgspec.Meta(ge=10, le=10000)] = 50
    """First pause between two attempts to connect; doubles up to four times."""
