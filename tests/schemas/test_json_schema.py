from __future__ import annotations

import json
from typing import get_args

import pytest

from surefoot.schemas.json_schema import JSON_DIR, all_schemas, as_text, json_schema
from surefoot.schemas.messages import SCHEMA_VERSION, JointState
from surefoot.schemas.motions import Motion
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.topics import TOPICS

SCHEMAS = all_schemas()


@pytest.mark.parametrize("name", SCHEMAS)
def test_file_is_what_the_code_says(name: str) -> None:
    text = (JSON_DIR / name).read_text(encoding="utf-8")
    assert text == as_text(SCHEMAS[name]), "run `make schemas`, look at the difference"


def test_every_file_has_its_format() -> None:
    assert {path.name for path in JSON_DIR.iterdir()} == set(SCHEMAS)


@pytest.mark.parametrize("name", SCHEMAS)
def test_schemas_stand_alone(name: str) -> None:
    text = json.dumps(SCHEMAS[name])
    assert "$ref" not in text
    assert "$defs" not in text


def test_every_topic_stands_in_the_description_of_its_message() -> None:
    for topic in TOPICS:
        text = json_schema(topic.message)["description"]
        assert f"{topic.name} (key {topic.key}" in text
        assert topic.description in text


def test_every_wire_field_is_required_and_no_other_allowed() -> None:
    for topic in TOPICS:
        schema = json_schema(topic.message)
        assert set(schema["required"]) == set(topic.message.__struct_fields__)
        assert schema["additionalProperties"] is False
        assert schema["properties"]["schema"]["const"] == SCHEMA_VERSION


def test_fields_carry_their_units() -> None:
    fields = json_schema(JointState)["properties"]
    assert fields["q"]["description"].startswith("Position [rad].")
    assert "One number per joint" in fields["q"]["description"]


def test_alternatives_are_written_out() -> None:
    schema = json_schema(Scenario)
    motions = schema["properties"]["platform"]["items"]["properties"]["motion"]
    kinds = [motion["properties"]["kind"] for motion in motions["items"]["anyOf"]]
    names = [kind.__struct_config__.tag for kind in get_args(Motion)]
    assert "sine" in names
    assert kinds == [{"enum": [name]} for name in names]
