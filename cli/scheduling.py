"""Processor and priority of a process, as the user asked for them."""

from __future__ import annotations

from surefoot.cli.logs import log_note, log_warning
from surefoot.errors import UsageError


def check_priority(priority: int | None, *, lockstep: bool) -> None:
    """Refuse a real-time priority to a loop that never rests.

    Raises:
        UsageError: nothing else would run on its processor.
    """
    if priority is not None and lockstep:
        raise UsageError(
            "--realtime-priority goes with --realtime; in lockstep the two never rest, "
            "and nothing else would run"
        )


def claim_processor(*, cpu: int | None, priority: int | None) -> None:
    """Pin this process and set its priority; go on without if not permitted.

    Called before anything starts a thread: threads inherit both.

    Args:
        cpu: processor to stay on; None for any.
        priority: of SCHED_FIFO; None for an ordinary process.
    """
    from surefoot.robot_io.realtime import pin_to_cpu, take_priority

    if cpu is not None:
        _tell(pin_to_cpu(cpu), f"on processor {cpu}")
    if priority is not None:
        _tell(take_priority(priority), f"SCHED_FIFO at priority {priority}")


def _tell(refusal: str, done: str) -> None:
    if refusal:
        log_warning(refusal)
    else:
        log_note(done)
