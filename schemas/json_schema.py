"""JSON Schema of every bus message and file format, for other languages and editors.

``python -m surefoot.schemas.json_schema`` writes them into ``schemas/json``. Each
schema stands alone: no ``$ref``, which some tools refuse.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import json
import re
import textwrap
from pathlib import Path
from typing import Any

import msgspec
import msgspec.inspect as types

from surefoot.schemas import messages
from surefoot.schemas.arrays import JsonObject
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.relay_plan import RelayPlan
from surefoot.schemas.result import RunResult
from surefoot.schemas.robot_file import RobotFile
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.topics import TOPICS

JSON_DIR = Path(__file__).parent / "json"

FILE_FORMATS: tuple[type[msgspec.Struct], ...] = (
    RobotFile,
    Scenario,
    Endpoints,
    RelayPlan,
    ControllerSettings,
    RunResult,
)

_REF = "#/$defs/"

_DROPPED = ("$ref", "discriminator")


def field_docs(kind: type[msgspec.Struct]) -> dict[str, str]:
    """Collect the text under each field of a struct and of its bases.

    Returns:
        Field name to its text on one line; fields without a text are left out.
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


def json_schema(kind: type[msgspec.Struct]) -> JsonObject:
    """Describe a message or file format.

    Returns:
        A JSON Schema (2020-12) without references; descriptions are the
        docstrings, followed by the channels that carry the message.
    """
    (root,), definitions = msgspec.json.schema_components(
        [kind], ref_template=_REF + "{name}"
    )
    for struct in structs_within(kind):
        _describe(definitions[struct.__name__], struct)
    schema: JsonObject = _inline(root, definitions)
    channels = [
        f"{topic.name} (key {topic.key}, {topic.direction}, {topic.rate}): "
        f"{topic.description}"
        for topic in TOPICS
        if topic.message is kind
    ]
    if channels:
        schema["description"] += "\n\nCarried by " + "; ".join(channels) + "."
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def all_schemas() -> dict[str, JsonObject]:
    """Return the schema of every message and file format by file name."""
    carried = [topic.message for topic in TOPICS] + [
        messages.ServiceReply,
        messages.StabilizerReply,
    ]
    kinds = dict.fromkeys([*carried, *FILE_FORMATS])
    schemas = {}
    for kind in kinds:
        snake = re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()
        schemas[f"{snake}.schema.json"] = json_schema(kind)
    return schemas


def as_text(schema: JsonObject) -> str:
    """Return the schema as it is written to its file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def write_schemas() -> None:
    """Write all schemas and remove those of formats that no longer exist."""
    JSON_DIR.mkdir(parents=True, exist_ok=True)
    texts = {name: as_text(schema) for name, schema in all_schemas().items()}
    for stale in JSON_DIR.glob("*.schema.json"):
        if stale.name not in texts:
            stale.unlink()
    for name, text in texts.items():
        (JSON_DIR / name).write_text(text, encoding="utf-8")


def _describe(schema: JsonObject, struct: type[msgspec.Struct]) -> None:
    schema["description"] = inspect.cleandoc(schema["description"])
    docs = field_docs(struct)
    per_joint: tuple[str, ...] = getattr(struct, "PER_JOINT", ())
    for name, field in schema["properties"].items():
        text = docs.get(name, "")
        if name in per_joint:
            text += " One number per joint of the robot file."
        if text:
            field["description"] = text.strip()
    if "schema" in schema["properties"]:
        schema["properties"]["schema"]["const"] = SCHEMA_VERSION


def structs_within(kind: type[msgspec.Struct]) -> dict[type[msgspec.Struct], str]:
    """List a struct and all structs at any depth of its fields, outer ones first.

    Returns:
        Struct to its table heading in TOML, such as ``[[platform.motion]]``; empty for
        the outermost.
    """
    found: dict[type[msgspec.Struct], str] = {}

    def visit(info: types.Type, path: str, brackets: str) -> None:
        match info:
            case types.StructType(cls=cls, fields=fields):
                head = f"{brackets[:2]}{path}{brackets[2:]}" if path else ""
                found.setdefault(cls, head.replace(" ", ""))
                for field in fields:
                    inner = f"{path}.{field.encode_name}" if path else field.encode_name
                    visit(field.type, inner, "[ ]")
            case types.ListType(item_type=inner):
                visit(inner, path, "[[]]")
            case types.DictType(value_type=inner):
                visit(inner, f"{path}.NAME", "[ ]")
            case types.UnionType(types=options):
                for option in options:
                    visit(option, path, brackets)

    visit(types.type_info(kind), "", "[ ]")
    return found


def _inline(node: Any, definitions: JsonObject) -> Any:
    """Replace references by their targets; no format contains itself."""
    if isinstance(node, list):
        return [_inline(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    # The discriminator only repeats the references: each option fixes its own tag.
    own = {key: item for key, item in node.items() if key not in _DROPPED}
    if "$ref" in node:
        own = {**definitions[node["$ref"].removeprefix(_REF)], **own}
    return {key: _inline(item, definitions) for key, item in own.items()}


if __name__ == "__main__":
    write_schemas()
