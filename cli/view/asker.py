"""Asks robot and stabilizer on behalf of the page, one request after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue

from cli.logs import log_note
from robot_io.errors import RequestRefusedError, RobotIoError
from robot_io.requests import Requests
from schemas.errors import SchemaError

Request = Callable[[Requests], object]


class Asker:
    """A thread that asks, so that a slow answer never holds up the picture.

    Attributes:
        notes: what was asked last and what came of it, newest last.
    """

    NOTES_KEPT = 4

    def __init__(self) -> None:
        """Starts the thread; it ends with the process."""
        self.notes: list[str] = []
        self._requests: Requests | None = None
        self._queue: SimpleQueue[tuple[str, Request]] = SimpleQueue()
        threading.Thread(target=self._work, name="asker", daemon=True).start()

    def through(self, requests: Requests | None) -> None:
        """Asks this way from now on; None when there is no robot."""
        self._requests = requests

    def ask(self, what: str, request: Request) -> None:
        """Queues a request.

        Args:
            what: in words, for the page and the log.
            request: called with the way to ask, on the asker's thread.
        """
        self._queue.put((what, request))

    def ask_now(self, what: str, request: Request) -> None:
        """Asks at once on the calling thread, past everything queued."""
        stamp_ns = time.monotonic_ns()
        requests = self._requests
        if requests is None:
            self._note(f"{what}: no robot to ask")
            return
        try:
            request(requests)
        except RequestRefusedError as error:
            self._note(f"{what}: refused, {error.reason}")
        except (RobotIoError, SchemaError) as error:
            self._note(f"{what}: {error}")
        else:
            self._note(f"{what}: done (asked at {stamp_ns} ns)", shown=f"{what}: done")

    def _work(self) -> None:
        while True:
            self.ask_now(*self._queue.get())

    def _note(self, text: str, *, shown: str | None = None) -> None:
        log_note(text)
        self.notes = [*self.notes, shown or text][-self.NOTES_KEPT :]
