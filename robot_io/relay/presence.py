"""Shows on one side of the relay who is there on the other."""

from __future__ import annotations

from functools import partial

import zenoh

from robot_io.bus import Bus
from robot_io.relay.dispatcher import Dispatcher


class PresenceMirror:
    """Declares the liveliness tokens of one side on the other, and withdraws them.

    After all that waits to be sent: what somebody said last comes before the news that
    it has gone.
    """

    def __init__(
        self, pattern: str, *, source: Bus, target: Bus, dispatcher: Dispatcher
    ) -> None:
        """Begins to mirror.

        Args:
            pattern: key of the tokens, such as ``alive/stabilizer/*``.
            source: where they are.
            target: where they are to be seen.
            dispatcher: declares and withdraws.
        """
        self._target, self._dispatcher = target, dispatcher
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        source.watch_presence(pattern, self._on_change)

    def _on_change(self, key: str, is_there: bool) -> None:
        self._dispatcher.do_last(partial(self._mirror, key, is_there))

    def _mirror(self, key: str, is_there: bool) -> None:
        if is_there and key not in self._tokens:
            liveliness = self._target.session.liveliness()
            self._tokens[key] = liveliness.declare_token(key)
        elif not is_there and key in self._tokens:
            # Zenoh gives this method no types.
            self._tokens.pop(key).undeclare()  # type: ignore[no-untyped-call]
