"""Progress of long work: the interface of a bar that the caller may provide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class CountBar(Protocol):
    """Opens a bar that counts. Entering it gives a function to call after each item."""

    def __call__(
        self, title: str, *, total: int, done: int, of: str = "runs"
    ) -> AbstractContextManager[Callable[[], None]]:
        """Open the bar.

        Args:
            title: name of the work.
            total: number of all items.
            done: number of items done before now.
            of: name of the items.
        """


@contextmanager
def no_bar(
    title: str, *, total: int, done: int, of: str = "runs"
) -> Iterator[Callable[[], None]]:
    """Provide a bar that shows nothing: the default throughout the library."""
    del title, total, done, of
    yield lambda: None
