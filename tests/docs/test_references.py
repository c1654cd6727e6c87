"""Every setting, message field and option has a description."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import msgspec
import pytest

import surefoot
from docs.site_build.api_page import api_page
from docs.site_build.bus_page import bus_page
from docs.site_build.commands_page import commands_page
from docs.site_build.docstring import parse
from docs.site_build.settings_page import settings_page
from docs.site_build.signals_page import signals_page
from docs.site_build.struct_table import FieldRow, field_rows
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.json_schema import structs_within
from surefoot.schemas.messages import ServiceReply, StabilizerReply
from surefoot.schemas.result import RunResult
from surefoot.schemas.robot_file import RobotFile
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.schemas.signals import SIGNALS
from surefoot.schemas.topics import PUBLISHED, TOPICS, Topic

ROOT = Path(__file__).parents[2]

FILES = (Scenario, RobotFile, Endpoints, RunResult)
SECTIONS = msgspec.structs.fields(ControllerSettings)


def rows_within(kind: type[msgspec.Struct]) -> list[tuple[str, FieldRow]]:
    return [
        (f"{struct.__name__}.{row.name}", row)
        for struct in structs_within(kind)
        for row in field_rows(struct)
    ]


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.name)
def test_every_setting_has_unit_effect_and_default(
    section: msgspec.structs.FieldInfo,
) -> None:
    rows = field_rows(section.type)
    assert rows
    for row in rows:
        assert row.text, row.name
        assert row.default, row.name
        assert row.range, row.name
        assert bool(row.unit) is row.is_numeric, row.name


@pytest.mark.parametrize("kind", FILES, ids=lambda kind: kind.__name__)
def test_every_key_of_a_file_has_words(kind: type[msgspec.Struct]) -> None:
    assert not [name for name, row in rows_within(kind) if not row.text]


def test_every_field_of_a_message_has_words() -> None:
    for kind in (*(topic.message for topic in TOPICS), ServiceReply, StabilizerReply):
        assert not [name for name, row in rows_within(kind) if not row.text]


def test_pages_hold_all_there_is() -> None:
    settings, bus, commands = settings_page(), bus_page(), commands_page()
    signals = signals_page()
    for signal in SIGNALS:
        assert f"| `{signal.name}` | (ticks" in signals
    for name in setting_names():
        section, key = name.split(".")
        table = settings.split(f"## `{section}`")[1].split("\n## ")[0]
        assert f"| `{key}` |" in table
    for topic in TOPICS:
        assert f"| {topic.name} | `{topic.key}` | [{topic.message.__name__}]" in bus
        assert f"### {topic.message.__name__}\n" in bus
    for words in ("## `surefoot run`", "`--lockstep / --realtime`", "| 130 |"):
        assert words in commands
    assert "--result-file" not in commands


@pytest.mark.parametrize(
    ("page", "command", "topics"),
    [
        ("recording", "record", PUBLISHED),
        ("recording", "log info", PUBLISHED),
        ("bus-tools", "topics", TOPICS),
        ("bus-tools", "hz", PUBLISHED),
    ],
)
def test_tables_that_pages_show_have_a_row_for_every_channel(
    page: str, command: str, topics: tuple[Topic, ...]
) -> None:
    text = (ROOT / f"docs/{page}.md").read_text(encoding="utf-8")
    table = text.split(f"\n$ surefoot {command}")[1].split("```")[0]
    rows = re.findall(r"^(?:│ )?(\w+) ", table, re.MULTILINE)
    known = {topic.name for topic in TOPICS}
    assert known & {*rows} == {topic.name for topic in topics}


def test_rows_tell_unit_range_and_default() -> None:
    rows = {row.name: row for row in field_rows(SECTIONS[1].type)}
    assert SECTIONS[1].name == "tsid"
    assert rows["com_kp"] == FieldRow(
        name="com_kp",
        type="3 numbers",
        unit="1/s²",
        range=">\N{NO-BREAK SPACE}0",
        default="30",
        text="CoM position gain, x y z.",
        is_numeric=True,
    )
    assert rows["normal_force_min_n"].unit == "N"


def test_tables_of_a_file_have_their_heads() -> None:
    heads = {kind.__name__: head for kind, head in structs_within(Scenario).items()}
    assert heads["Scenario"] == ""
    assert heads["SineMotion"] == "[[platform.motion]]"
    assert heads["Sensors"] == "[sensors]"
    robot = {kind.__name__: head for kind, head in structs_within(RobotFile).items()}
    assert robot["ServoProfile"] == "[servo.profiles.NAME]"


def test_the_api_page_has_every_public_name_with_words() -> None:
    page = api_page()
    for name in surefoot.__all__:
        entry = page.split(f"\n### `{name}`\n")[1].split("\n### ")[0]
        words = re.sub(r"```.*?```", "", entry, flags=re.DOTALL).split("\n## ")[0]
        assert len(words.split()) >= 4, name
        value = getattr(surefoot, name)
        if inspect.isfunction(value):
            for parameter in inspect.signature(value).parameters:
                assert f"- `{parameter}`: " in entry, f"{name}: {parameter}"


def test_a_docstring_becomes_markdown() -> None:
    doc = parse(
        "Do it.\n\nSee :func:`run` and ``x``::\n\n    do(1)\n\nArgs:\n"
        "    x: what\n        follows [m].\n\nReturns:\n    A :class:`Thing`.",
        known={"run"},
    )
    assert doc.text == (
        "Do it.\n\nSee [`run`](#run) and `x`\n\n```python\ndo(1)\n```\n"
    )
    assert doc.sections == [
        ("Args", "**Arguments**\n\n- `x`: what follows [m].\n"),
        ("Returns", "**Returns**\n\nA `Thing`.\n"),
    ]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_every_link_of_the_front_pages_leads_somewhere(page: str) -> None:
    links = re.findall(r"\]\(([^)#\s]+)", (ROOT / page).read_text())
    local = [link for link in links if "://" not in link]
    assert local
    assert [link for link in local if not (ROOT / link).exists()] == []
