"""Turns what is heard on a channel into lines."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import msgspec

from cli.bus.fields import pick
from cli.bus.words import NS_PER_S, field_lines, message_lines
from robot_io.listener import Heard
from schemas.codec import decode
from schemas.errors import MessageError
from schemas.topics import Topic


class Echo:
    """Shows messages of one channel.

    Attributes:
        count: messages shown, malformed ones included.
    """

    def __init__(
        self,
        topic: Topic,
        *,
        joint_count: int,
        fields: Iterable[str],
        rate_hz: float | None,
        as_json: bool,
    ) -> None:
        """Keeps what to show.

        Args:
            topic: the channel.
            joint_count: n_a of the robot.
            fields: paths; all of the message when there are none.
            rate_hz: most messages shown in a second; others are passed over.
            as_json: a JSON object instead of words.
        """
        self.count = 0
        self._topic, self._joint_count = topic, joint_count
        self._fields = list(fields)
        self._pause_ns = 0 if rate_hz is None else round(NS_PER_S / rate_hz)
        self._due_ns = 0
        self._as_json = as_json

    def lines(self, heard: Heard) -> list[str]:
        """Lines to print for a message; none when it is passed over.

        Raises:
            UsageError: the message has no such field.
        """
        if heard.received_ns < self._due_ns:
            return []
        self._due_ns = heard.received_ns + self._pause_ns
        self.count += 1
        try:
            message = decode(
                heard.data, self._topic.message, joint_count=self._joint_count
            )
        except MessageError as error:
            return self._malformed(str(error), size=len(heard.data))
        return self._shown(msgspec.to_builtins(message), size=len(heard.data))

    def _shown(self, message: dict[str, Any], *, size: int) -> list[str]:
        if not self._fields:
            if self._as_json:
                return [_json(message)]
            return message_lines(self._topic.name, message, size=size)
        picked = {path: pick(message, path) for path in self._fields}
        if self._as_json:
            return [_json({"tick": message["tick"], **picked})]
        return [f"{self._topic.name}  tick {message['tick']}", *field_lines(picked)]

    def _malformed(self, reason: str, *, size: int) -> list[str]:
        if self._as_json:
            return [_json({"malformed": reason, "bytes": size})]
        return [f"{self._topic.name}  MALFORMED, {size} bytes: {reason}"]


def _json(value: dict[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False)
