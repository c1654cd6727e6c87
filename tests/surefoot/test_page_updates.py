"""Whatever is drawn reaches the browser, whichever moment it is drawn in."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from surefoot.view.page import wake_on_loop
from tests.support import PATIENCE_S

viser = pytest.importorskip("viser", reason="needs viser: pip install -e .[view]")


@pytest.fixture
def server() -> Iterator[Any]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    wake_on_loop(server)
    yield server
    server.stop()


def test_a_message_between_look_and_wait_wakes_the_sender(
    server: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = server._websock_server.get_message_buffer()
    loop = buffer.event_loop
    make_future = loop.create_future

    def draw_then_make_future() -> Any:
        """Draw on another thread where ``Event.wait`` has looked and is to wait."""
        monkeypatch.setattr(loop, "create_future", make_future)
        thread = threading.Thread(target=server.gui.add_html, args=("FAULT",))
        thread.start()
        thread.join()
        return make_future()

    async def wait() -> bool:
        buffer.message_event.clear()
        monkeypatch.setattr(loop, "create_future", draw_then_make_future)
        return bool(await buffer.message_event.wait())

    woken = asyncio.run_coroutine_threadsafe(wait(), loop)
    assert woken.result(timeout=PATIENCE_S)


def test_a_group_of_messages_wakes_the_sender(server: Any) -> None:
    buffer = server._websock_server.get_message_buffer()
    is_waiting = threading.Event()

    async def wait() -> bool:
        buffer.message_event.clear()
        is_waiting.set()
        return bool(await buffer.message_event.wait())

    woken = asyncio.run_coroutine_threadsafe(wait(), buffer.event_loop)
    assert is_waiting.wait(PATIENCE_S)
    with server.atomic():
        server.gui.add_html("FAULT")
    assert woken.result(timeout=PATIENCE_S)
