"""The code has the messages that the page explains."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from surefoot.errors import ExitCode

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
PACKAGES = ("schemas", "robot_io", "stabilizer", "sim_robot", "cli", "surefoot")
QUOTED = [
    message
    for line in PAGE.splitlines()
    if line.startswith("### ")
    for message in re.findall("`([^`]+)`", line)
]


def texts(tree: ast.AST) -> list[str]:
    """Return all strings of a module, without the variable parts of f-strings."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [
                part.value if isinstance(part, ast.Constant) else "\0"
                for part in node.values
            ]
            found.append("".join(map(str, parts)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
    return found


def said() -> str:
    """Return all strings of the project, joined."""
    modules = [path for name in PACKAGES for path in (ROOT / name).rglob("*.py")]
    parts = [(ROOT / "Makefile").read_text(encoding="utf-8")]
    for path in modules:
        parts += texts(ast.parse(path.read_text(encoding="utf-8")))
    return "\n".join(parts)


def test_every_quoted_message_occurs_in_the_code() -> None:
    everything = said()
    assert len(QUOTED) > 25
    for message in QUOTED:
        for piece in filter(None, map(str.strip, message.split("…"))):
            assert piece.strip("();:") in everything, f"{message}: {piece!r}"


def test_all_exit_codes_are_explained() -> None:
    for code in ExitCode:
        assert f"\n| {int(code)} |" in PAGE
