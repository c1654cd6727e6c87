"""No code decides by the words of a reason."""

from __future__ import annotations

import ast
from enum import StrEnum
from pathlib import Path

import pytest

from surefoot.schemas import reasons
from surefoot.schemas.reasons import EndReason, in_words

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "robot_io", "stabilizer", "sim_robot", "surefoot", "cli")
WORDS = ("reason", "detail", "notice", "cause", "end", "outcome", "state", "refusal")
PARTS_OF_TEXTS = ("startswith", "endswith", "removeprefix", "removesuffix", "find")
ENUMS = [
    kind
    for kind in vars(reasons).values()
    if isinstance(kind, type) and issubclass(kind, StrEnum) and kind is not StrEnum
]


def is_words(node: ast.expr) -> bool:
    """Return whether a name is that of a reason or of its words: ``status.detail``."""
    name = getattr(node, "attr", getattr(node, "id", ""))
    return name.split("_")[-1] in WORDS


def decisions(tree: ast.AST) -> list[int]:
    """Return the lines that compare the words of a reason."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in PARTS_OF_TEXTS and is_words(node.func.value):
                found.append(node.lineno)
        elif isinstance(node, ast.Compare):
            pairs = zip(node.ops, node.comparators, strict=True)
            found += [
                node.lineno
                for op, right in pairs
                if isinstance(op, (ast.In, ast.NotIn)) and is_words(right)
            ]
    return found


def test_the_search_finds_what_it_is_for() -> None:
    for line in (
        "result.reason.startswith('fell')",
        "'held' in status.detail",
        "lost_reason.endswith(JUMP)",
    ):
        assert decisions(ast.parse(line)) == [1]
    assert decisions(ast.parse("result.end in (EndReason.FELL, EndReason.NONE)")) == []


def test_nothing_is_decided_by_the_words_of_a_reason() -> None:
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            lines = decisions(ast.parse(path.read_text(encoding="utf-8")))
            if lines:
                found[str(path.relative_to(ROOT))] = lines
    assert found == {}


@pytest.mark.parametrize("kind", ENUMS, ids=lambda kind: kind.__name__)
def test_every_reason_is_one_word_of_lower_case(kind: type[StrEnum]) -> None:
    for reason in kind:
        assert reason == reason.name.lower()
        assert reason.isidentifier()


def test_words_come_after_the_reason() -> None:
    assert in_words(EndReason.SENSOR_LOST, "imu missing") == "sensor lost: imu missing"
    assert in_words(EndReason.ROBOT_GONE, "") == "robot gone"
