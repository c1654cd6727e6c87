"""Docstrings of a struct's fields: the strings that stand under them."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap

import msgspec


def field_docs(kind: type[msgspec.Struct]) -> dict[str, str]:
    """Collect what is written under each field of a struct and its bases.

    Args:
        kind: a struct class whose source is at hand.

    Returns:
        Field name to its text on one line; fields without one are left out.
    """
    docs: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if issubclass(base, msgspec.Struct) and base is not msgspec.Struct:
            docs.update(_own_docs(base))
    return docs


def _own_docs(kind: type[msgspec.Struct]) -> dict[str, str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    docs: dict[str, str] = {}
    for statement, after in itertools.pairwise(body):
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
        ):
            docs[statement.target.id] = " ".join(after.value.value.split())
    return docs
