"""Reference of the robot's bus, from the topic table and the message structs."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from docs.site_build.struct_table import (
    FieldRow,
    field_rows,
    first_line,
    literals,
    table,
)
from surefoot.robot_io.identity import PARTS
from surefoot.schemas import messages
from surefoot.schemas.json_schema import structs_within
from surefoot.schemas.messages import SCHEMA_VERSION, Message
from surefoot.schemas.topics import (
    ALIVE_OBSERVER,
    ALIVE_ROBOT,
    ALIVE_STABILIZER,
    TOPICS,
)

_HEAD = f"""# Bus

What robot and stabilizer say to each other, written from the topic table
[`schemas/topics.py`](../../schemas/topics.py#TOPICS) and the structs in
[`schemas/messages.py`](../../schemas/messages.py).

- Transport is Zenoh; the robot's name is the session's namespace, so the joints of
  `walker` are on `walker/state/joints`. A robot file may [rename keys](robot-file.md).
- A message is a MessagePack map with string keys. All fields are required, unknown ones
  are refused, and every number must be finite. SI units and radians.
- A wrench is [force; moment], of the ground on the robot. Quaternions are x y z w.
- The format has version {SCHEMA_VERSION}, which every message carries as `schema`. JSON
  Schema of each: [`schemas/json`](../../schemas/json).
- The robot listens, everyone else dials. Liveliness tokens: `{ALIVE_STABILIZER}/NAME`,
  `{ALIVE_OBSERVER}/NAME`, and the robot's, which says who it is.

## Who is who

The robot's token is `{ALIVE_ROBOT}/INSTANCE/DESCRIPTION`, and every answer of its
services repeats both. `INSTANCE` is another word at every start of the process.
`DESCRIPTION` is a digest of what both sides must agree on, {len(PARTS)} hashes joined
by `-`, of: {", ".join(PARTS)}. Who finds other hashes than those of its own robot
file has met another robot. A commander names both when it takes the lease, and is
refused when it means another robot. A driver in another language takes the digest of
its robot file as a fixed word from:

```python
from surefoot import load_robot
from surefoot.robot_io.identity import describe

print(describe(load_robot("your.toml")))
```
"""
_COLUMNS = ("name", "type", "unit", "range", "text")
_REPLIES: tuple[type[msgspec.Struct], ...] = (
    messages.ServiceReply,
    messages.StabilizerReply,
)


def bus_page() -> str:
    """Markdown: all channels, then each message with its fields."""
    parts = [_HEAD, "## Channels\n", _channels(), "## Messages\n"]
    parts.append(
        "Those on a topic carry these three besides their own:\n\n"
        + table(field_rows(Message), _COLUMNS)
    )
    for kind in _messages():
        parts.append(_message(kind))
    return "\n".join(parts)


def _channels() -> str:
    lines = ["| channel | key | message | direction | rate | what |", "|" + "---|" * 6]
    for topic in TOPICS:
        name = topic.message.__name__
        lines.append(
            f"| {topic.name} | `{topic.key}` | [{name}](#{name.lower()}) | "
            f"{topic.direction} | {topic.rate} | {topic.description} |"
        )
    return "\n".join(lines) + "\n"


def _messages() -> list[type[msgspec.Struct]]:
    """Every message, and every struct inside one, once."""
    carried: list[type[msgspec.Struct]] = [topic.message for topic in TOPICS]
    found: dict[type[msgspec.Struct], None] = {}
    for kind in [*carried, *_REPLIES]:
        found.update(dict.fromkeys(structs_within(kind)))
    return list(found)


def _message(kind: type[msgspec.Struct]) -> str:
    common = {row.name for row in field_rows(Message)}
    per_joint: tuple[str, ...] = getattr(kind, "PER_JOINT", ())
    rows = [_per_joint(row, per_joint) for row in field_rows(kind)]
    if issubclass(kind, Message):
        rows = [row for row in rows if row.name not in common]
    keys = [f"`{topic.key}`" for topic in TOPICS if topic.message is kind]
    where = f" Carried by {', '.join(keys)}." if keys else ""
    return f"### {kind.__name__}\n\n{literals(first_line(kind))}{where}\n\n" + table(
        rows, _COLUMNS
    )


def _per_joint(row: FieldRow, per_joint: tuple[str, ...]) -> FieldRow:
    is_one = row.name in per_joint
    return replace(row, type="number per joint") if is_one else row
