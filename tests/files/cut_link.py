"""A network cable that a test can unplug and plug in again."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import TracebackType
from typing import Self

_BYTES = 65536


class Cable:
    """Forwards TCP from a port of its own to another port of this host.

    Attributes:
        locator: where to dial it.
    """

    def __init__(self, target: str) -> None:
        host, port = target.removeprefix("tcp/").rsplit(":", 1)
        self._target = (host, int(port))
        self._server = socket.create_server(("127.0.0.1", 0))
        self._ends: list[socket.socket] = []
        self._plugged = threading.Event()
        self._plugged.set()
        self.locator = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._server.close()
        self.pull()

    def pull(self) -> None:
        """Unplug: both sides lose each other, and new connections are refused."""
        self._plugged.clear()
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self._ends.clear()

    def plug_in(self) -> None:
        """Plug in: new connections pass again."""
        self._plugged.set()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
            except OSError:
                return
            if not self._plugged.is_set():
                near.close()
                continue
            try:
                far = socket.create_connection(self._target)
            except ConnectionRefusedError:  # the robot is gone
                near.close()
                continue
            self._ends += [near, far]
            for source, target in ((near, far), (far, near)):
                threading.Thread(
                    target=self._pass_on, args=(source, target), daemon=True
                ).start()

    def _pass_on(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(_BYTES):
                target.sendall(data)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
