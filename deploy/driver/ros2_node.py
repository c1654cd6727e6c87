"""What the ROS 2 programs share: a node, quality of service, and how they complain."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from surefoot.errors import exit_code_of

try:
    import rclpy
    from rclpy.qos import ReliabilityPolicy
    from rclpy.signals import SignalHandlerOptions
except ImportError as error:
    print(
        f"surefoot: rclpy cannot be imported ({error}); source your ROS 2 (setup.bash) "
        "in an environment of the same Python, or: pip install 'surefoot[ros2]'",
        file=sys.stderr,
    )
    sys.exit(3)

RELIABILITY = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}


@contextmanager
def ros2_node(name: str) -> Iterator[Any]:
    """A node in a context of its own; signals stay with the caller."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(name)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


def complain(program: Callable[[], object]) -> None:
    """Run a program; an error that was foreseen is one line and its exit code."""
    try:
        program()
    except Exception as error:  # all kinds: those without a code go on below
        code = exit_code_of(error)
        if code is None:
            raise
        print(f"surefoot: {error}", file=sys.stderr)
        sys.exit(code)
