"""A port for the page."""

from __future__ import annotations

import socket

from cli.errors import EnvironmentFailedError


def free_port(port: int) -> int:
    """Makes sure that a port of the loopback interface is free.

    Args:
        port: wanted; 0 for any.

    Returns:
        The port.

    Raises:
        EnvironmentFailedError: somebody else serves there.
    """
    try:
        with socket.create_server(("127.0.0.1", port)) as server:
            return int(server.getsockname()[1])
    except OSError as error:
        raise EnvironmentFailedError(
            f"cannot serve the page at 127.0.0.1:{port}: {error.strerror or error}; "
            "stop who serves there, or choose another with --port"
        ) from error
