"""Runs the bus tools."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest

from surefoot.schemas.endpoints import Endpoints
from tests.command import Surefoot
from tests.support import PATIENCE_S

Ask = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def ask(surefoot_here: Surefoot, endpoints: Endpoints) -> Ask:
    """Run a tool on the bus of ``endpoints``, and check its exit code."""

    def run(*words: object, code: int = 0) -> subprocess.CompletedProcess[str]:
        where = ("--connect", endpoints.connect[0], "--wait", PATIENCE_S)
        done = surefoot_here(*words, *where)
        assert done.returncode == code, done.stderr
        return done

    return run
