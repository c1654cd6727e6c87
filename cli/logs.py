"""What the processes say while they run: one line each on stderr."""

from __future__ import annotations

import logging
import os

_LOG = logging.getLogger("surefoot")


def set_up_logging(name: str) -> None:
    """Send our own notes, warnings and errors to stderr.

    Args:
        name: of the process, said first together with its number.
    """
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        datefmt="%H:%M:%S",
    )
    log_note(f"{name}, process {os.getpid()}")


def log_note(text: str) -> None:
    """Say something in passing."""
    _LOG.info(text)


def log_warning(text: str) -> None:
    """Say something the user should not miss."""
    _LOG.warning(text)
