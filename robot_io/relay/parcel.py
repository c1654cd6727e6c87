"""A message on its way through the relay."""

from __future__ import annotations

from typing import NamedTuple


class Parcel(NamedTuple):
    """Bytes and when they go on.

    Attributes:
        at_s: when, on the clock they arrived by [s].
        data: the message, encoded.
        in_order: whether it waits for those before it; False for one that was kept
            back while others overtook it.
    """

    at_s: float
    data: bytes
    in_order: bool = True
