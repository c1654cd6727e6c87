"""Status and faults in words."""

from __future__ import annotations

import html
from typing import NamedTuple

from robot_io.sight import Sight
from schemas.messages import RobotMode

GREEN, AMBER, RED, GREY = "#1a9c5f", "#c77700", "#d8434e", "#7a828c"


class Verdict(NamedTuple):
    """How the robot fares, in a headline and a sentence.

    Attributes:
        headline: a word or two.
        colour: of its badge.
        detail: why, or what to do.
    """

    headline: str
    colour: str
    detail: str


def verdict(
    sight: Sight, *, robot_is_here: bool, stabilizer_is_here: bool, where: str
) -> Verdict:
    """Says in words what was seen.

    Args:
        sight: newest messages.
        robot_is_here: whether its process is alive.
        stabilizer_is_here: whether a stabilizer's is.
        where: locators dialed.
    """
    status, stabilizer = sight.status, sight.stabilizer
    if not robot_is_here:
        if status is None:
            return Verdict("waiting", GREY, f"for a robot at {where}")
        detail = status.reason or "its process has ended"
        return Verdict("robot gone", GREY, f"last word: {detail}")
    if status is None:
        return Verdict("waiting", GREY, "the robot has not said anything yet")
    if status.mode is RobotMode.FAULT:
        return Verdict("FAULT", RED, f"{status.fault}; the posture is kept until reset")
    if status.mode is RobotMode.OFF:
        return Verdict("off", GREY, status.reason or "follows nobody")
    if status.mode is RobotMode.HOLD:
        return Verdict("HOLD", AMBER, status.reason or "keeps its posture")
    if not stabilizer_is_here:
        return Verdict("no stabilizer", RED, "nobody answers the robot's ticks")
    if stabilizer is not None and stabilizer.state != "active":
        return Verdict(stabilizer.state, AMBER, stabilizer.reason)
    lost = _feet_in_the_air(sight)
    if lost:
        return Verdict("balancing", AMBER, f"{lost} without contact")
    return Verdict("balancing", GREEN, "both feet stand, both QPs solved")


def status_html(words: Verdict, sight: Sight, *, period_s: float) -> str:
    """A badge, the sentence, and who does what.

    Args:
        words: the verdict.
        sight: newest messages.
        period_s: control period [s].
    """
    status, stabilizer = sight.status, sight.stabilizer
    rows = []
    if status is not None:
        rows.append(("time", f"{status.tick * period_s:.1f} s"))
        rows.append(("commander", status.commander or "nobody"))
        if status.reason and status.reason not in words.detail:
            rows.append(("robot says", status.reason))
        rows.append(("refused", _counts(status.refused)))
        rows.append(("clipped", _counts(status.clipped)))
        rows.append(("missed ticks", str(status.deadline_misses)))
    if stabilizer is not None:
        rows.append(("QPs", stabilizer.qp_status))
    table = "".join(
        f"<tr><td style='color:#7a828c;padding-right:1em'>{name}</td>"
        f"<td>{html.escape(text)}</td></tr>"
        for name, text in rows
    )
    return (
        "<div style='padding:0.2em 0.8em 0.4em;font-size:0.82em;line-height:1.45'>"
        f"<div id='surefoot-state'><span style='background:{words.colour};color:#fff;"
        "border-radius:4px;padding:0.15em 0.6em;font-weight:600;font-size:1.1em'>"
        f"{html.escape(words.headline)}</span> &nbsp;{html.escape(words.detail)}</div>"
        f"<table style='margin-top:0.5em'>{table}</table></div>"
    )


def _feet_in_the_air(sight: Sight) -> str:
    if sight.stabilizer is None:
        return ""
    sides = zip(("left foot", "right foot"), sight.stabilizer.in_contact, strict=True)
    return " and ".join(side for side, stands in sides if not stands)


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"
