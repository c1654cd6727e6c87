"""What the ROS 2 programs share: a node and quality of service."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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
