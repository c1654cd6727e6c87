"""Reference of the Python library, from ``surefoot.__all__`` and its docstrings."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from operator import attrgetter
from typing import Any

import msgspec

import surefoot
from docs.site_build.docstring import parse
from docs.site_build.struct_table import field_rows, table

_HEAD = """# Python API

Everything `import surefoot as sf` offers, written from the docstrings. SI units and
radians everywhere but in scenarios, whose keys carry their unit; `n_a` is the number of
joints, and arrays have one row per tick unless said otherwise. A wrench is
[force; moment] of the ground on the robot. Terms: [Glossary](../glossary.md). For
programs that use it see [`examples`](../../examples).
"""
_LINE = 88
_TITLES = {
    "function": "Functions",
    "class": "Classes",
    "struct": "Structs",
    "error": "Errors",
    "type": "Types",
    "module": "Modules",
}
_COLUMNS = ("name", "type", "unit", "range", "default", "text")


def api_page() -> str:
    """Markdown of every public name: signature, description, arguments, results."""
    names = {kind: list(_of_kind(kind)) for kind in _TITLES}
    parts = [_HEAD]
    for kind, title in _TITLES.items():
        if names[kind]:
            parts.append(f"## {title}\n")
            parts += [_entry(name, kind) for name in names[kind]]
    return "\n".join(parts)


def _of_kind(kind: str) -> Iterator[str]:
    for name in sorted(surefoot.__all__, key=str.lower):
        if _kind(getattr(surefoot, name)) == kind:
            yield name


def _kind(value: Any) -> str:
    if inspect.ismodule(value):
        return "module"
    if not inspect.isclass(value):
        return "function" if callable(value) and hasattr(value, "__name__") else "type"
    if issubclass(value, BaseException):
        return "error"
    return "struct" if issubclass(value, msgspec.Struct) else "class"


def _entry(name: str, kind: str) -> str:
    value = attrgetter(name)(surefoot)
    parts = [f"### `{name}`\n"]
    is_constructed = kind == "class" and _is_constructed(value)
    if kind == "function" or is_constructed:
        parts.append(_code(f"sf.{name}", value))
    doc = parse(inspect.getdoc(value) or "", known=set(surefoot.__all__))
    parts.append(doc.text)
    if kind == "struct":
        parts.append(table(field_rows(value), _COLUMNS))
        return "\n".join(parts)
    if is_constructed:
        init = parse(inspect.getdoc(value.__init__) or "", known=set(surefoot.__all__))
        parts += [section for title, section in init.sections if title != "Returns"]
    parts += [section for _, section in doc.sections]
    if kind == "class":
        parts += _methods(name, value)
    if kind == "module":
        inner = [f"{name}.{member}" for member in value.__all__]
        parts += [_entry(n, _kind(attrgetter(n)(surefoot))) for n in inner]
    return "\n".join(parts)


def _is_constructed(kind: type) -> bool:
    """Whether a user calls the class; results and protocols are only given to them."""
    own = vars(kind).get("__init__", kind)
    if dataclasses.is_dataclass(kind) or own is kind:
        return False
    return bool(own.__doc__) and not getattr(kind, "_is_protocol", False)


def _methods(name: str, kind: type) -> list[str]:
    """Public methods and properties of a class itself, in their order."""
    parts = []
    for attribute, raw in vars(kind).items():
        if attribute.startswith("_") or not inspect.getdoc(raw):
            continue
        doc = parse(inspect.getdoc(raw) or "", known=set(surefoot.__all__))
        if isinstance(raw, property):
            parts.append(f"#### `{name}.{attribute}`\n\n{doc.text}")
        elif callable(raw) or isinstance(raw, classmethod | staticmethod):
            bound = getattr(kind, attribute)
            parts.append(f"#### `{name}.{attribute}()`\n")
            parts.append(_code(f"{name}.{attribute}", bound, drop_self=True))
            parts.append(doc.text)
            parts += [section for _, section in doc.sections]
    return parts


def _code(name: str, function: Any, *, drop_self: bool = False) -> str:
    """Signature in a block, one argument per line when it is long."""
    signature = inspect.signature(function)
    parameters = list(signature.parameters.values())
    if drop_self and parameters and parameters[0].name == "self":
        parameters = parameters[1:]
    texts = list(_arguments(parameters))
    answer = _annotation(signature.return_annotation)
    end = f" -> {answer}" if answer and not inspect.isclass(function) else ""
    line = f"{name}({', '.join(texts)}){end}"
    if len(line) > _LINE:
        inner = "".join(f"    {text},\n" for text in texts)
        line = f"{name}(\n{inner}){end}"
    return f"```python\n{line}\n```\n"


def _arguments(parameters: list[inspect.Parameter]) -> Iterator[str]:
    is_marked = False
    for parameter in parameters:
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not is_marked:
            is_marked = True
            yield "*"
        text = parameter.name
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            is_marked, text = True, f"*{text}"
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            text = f"**{text}"
        annotation = _annotation(parameter.annotation)
        if annotation:
            text += f": {annotation}"
        if parameter.default is not inspect.Parameter.empty:
            text += f" = {_default(parameter.default)}"
        yield text


def _annotation(annotation: Any) -> str:
    if annotation is inspect.Parameter.empty:
        return ""
    text = (
        annotation
        if isinstance(annotation, str)
        else inspect.formatannotation(annotation)
    )
    return re.sub(
        r"\b(?:surefoot|numpy|pathlib|collections)(?:\.\w+)*\.(?=\w)", "", text
    )


def _default(value: Any) -> str:
    if callable(value):
        return str(value.__name__)
    return f'"{value}"' if isinstance(value, str) else repr(value)
