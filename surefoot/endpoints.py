"""Where the processes of a command meet: file, options, or a free port of this host."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from surefoot.schemas.endpoints import Endpoints, load_endpoints
from surefoot.schemas.toml_file import toml_text

ENDPOINTS = "endpoints.toml"


def choose_endpoints(
    file: Path | None,
    *,
    listen: list[str],
    connect: list[str],
    router: list[str] | None = None,
    insecure: bool = False,
) -> Endpoints:
    """Join an endpoint file and the command line.

    Args:
        file: endpoint file, or None for the defaults.
        listen: replaces the file's ``listen`` unless empty.
        connect: replaces the file's ``connect`` and ``router`` unless empty.
        router: replaces the file's ``router`` unless empty.
        insecure: listen on other addresses than loopback without TLS.

    Raises:
        FileFormatError: the file cannot be used.
    """
    endpoints = Endpoints() if file is None else load_endpoints(file)
    if listen:
        endpoints = msgspec.structs.replace(endpoints, listen=list(listen))
    if connect:
        endpoints = msgspec.structs.replace(endpoints, connect=list(connect))
        endpoints = msgspec.structs.replace(endpoints, router=[])
    if router:
        endpoints = msgspec.structs.replace(endpoints, router=list(router))
    if insecure:
        endpoints = msgspec.structs.replace(endpoints, insecure=True)
    return endpoints


ONE_HOST_LEASE_MS = 10_000
"""Between processes of one run a death closes the link at once. What is silent and not
dead is a process that a busy machine has not let run."""
LONGEST_SOCKET_PATH = 90
"""Systems allow 104 or 108 bytes, and Zenoh puts a lock file beside the socket."""


@contextmanager
def private_bus() -> Iterator[Endpoints]:
    """Provide a private bus: a Unix socket in a folder that only this user enters.

    No other process can take its address meanwhile, and it costs the loop less than
    the loopback interface. Without such sockets, or with a path too long, a free port.
    """
    with tempfile.TemporaryDirectory(prefix="surefoot-") as folder:
        path = f"{folder}/bus"
        if os.name != "posix" or len(path.encode()) > LONGEST_SOCKET_PATH:
            yield loopback_endpoints()
            return
        locator = f"unixsock-stream/{path}"
        yield _one_host(locator)


def loopback_endpoints() -> Endpoints:
    """Choose a free port of the loopback interface for both sides of one run."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return _one_host(f"tcp/127.0.0.1:{port}")


def _one_host(locator: str) -> Endpoints:
    return Endpoints(listen=[locator], connect=[locator], lease_ms=ONE_HOST_LEASE_MS)


def write_endpoints(path: Path, endpoints: Endpoints) -> None:
    """Write endpoints without certificates, such that they read back the same.

    Args:
        path: of the TOML.
        endpoints: what to write; paths of certificates would be relative to the file.
    """
    keys = msgspec.to_builtins(endpoints)
    if keys.pop("tls") is not None:
        raise ValueError("endpoints: got certificates, expected none to be copied")
    path.write_text(toml_text(keys), encoding="utf-8")
