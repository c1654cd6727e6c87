"""What a replay through the controller found, for people."""

from __future__ import annotations

from rich.table import Table

from surefoot.playback.recompute import Difference, ReplayOutcome


def outcome_table(outcome: ReplayOutcome) -> Table:
    """Return a table with one row per stabilizer of the record."""
    table = Table("stabilizer", "controller", "ticks", "compared", "differing")
    for session in outcome.sessions:
        table.add_row(
            session.commander,
            session.controller,
            f"{session.first_tick} to {session.last_tick}",
            str(session.compared),
            str(session.differing),
        )
    return table


def verdict(outcome: ReplayOutcome) -> str:
    """Say whether all commands are equal, or where they differ."""
    if outcome.is_equal:
        return f"all {outcome.compared} commands are equal, bit for bit"
    session = next(session for session in outcome.sessions if session.differing)
    first, largest = session.first, session.largest
    assert first is not None
    assert largest is not None
    return (
        f"{session.differing} of {session.compared} commands of {session.commander} "
        f"differ\n"
        f"first: {_words(first)}\n"
        f"largest: {_words(largest)}\n"
        "Each tick has the recorded sensors; how the robot would have moved with the "
        "computed commands is not told by this."
    )


def _words(found: Difference) -> str:
    return (
        f"tick {found.tick} ({found.time_s:.3f} s), {found.joint}: recorded "
        f"{found.recorded:.17g}, computed {found.computed:.17g} rad, "
        f"{found.error:+.3g}"
    )
