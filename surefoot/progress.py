"""How far long work is: a bar that whoever starts it may show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class CountBar(Protocol):
    """Opens a bar that counts; entering it gives a function to call after each."""

    def __call__(
        self, title: str, *, total: int, done: int, of: str = "runs"
    ) -> AbstractContextManager[Callable[[], None]]:
        """Open the bar.

        Args:
            title: what is under way.
            total: of all things.
            done: already, before now.
            of: what the things are called.
        """


@contextmanager
def no_bar(
    title: str, *, total: int, done: int, of: str = "runs"
) -> Iterator[Callable[[], None]]:
    """Provide a bar that shows nothing: the default throughout the library."""
    del title, total, done, of
    yield lambda: None
