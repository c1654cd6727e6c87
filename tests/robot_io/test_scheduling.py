"""Processor and priority of a process, each set in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from surefoot.robot_io.realtime import pin_to_cpu

NOBODY = 65534
UNPRIVILEGED = f"""
import os, resource
from surefoot.robot_io.realtime import take_priority
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
if os.geteuid() == 0:
    os.setuid({NOBODY})
print(take_priority(50))
print(os.sched_getscheduler(0) == os.SCHED_OTHER)
"""
PINNED = """
import os, sys
from surefoot.robot_io.realtime import pin_to_cpu
cpu = max(os.sched_getaffinity(0))
print(pin_to_cpu(cpu) == "" and os.sched_getaffinity(0) == {cpu})
"""
PERMITTED = """
import os
from surefoot.robot_io.realtime import take_priority
refusal = take_priority(1)
print(bool(refusal) != (os.sched_getscheduler(0) == os.SCHED_FIFO))
"""

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_setscheduler"), reason="SCHED_FIFO is a matter of Linux"
)


def printed(script: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_a_priority_that_is_not_permitted_is_told_in_one_line_with_a_way_out() -> None:
    refusal, is_ordinary = printed(UNPRIVILEGED)
    assert refusal.startswith("--realtime-priority 50: not done, not permitted")
    assert "limit of this account: 0" in refusal
    assert "rtprio 50" in refusal
    assert "LimitRTPRIO=50" in refusal
    assert is_ordinary == "True"


def test_a_priority_is_taken_or_the_refusal_is_told() -> None:
    assert printed(PERMITTED) == ["True"]


def test_a_process_stays_on_its_processor() -> None:
    assert printed(PINNED) == ["True"]


def test_a_processor_that_is_not_there_is_told() -> None:
    before = os.sched_getaffinity(0)
    refusal = pin_to_cpu(100_000)
    assert refusal.startswith("--cpu 100000: not done, no such processor")
    assert os.sched_getaffinity(0) == before
