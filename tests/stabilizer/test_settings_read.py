"""Single settings that the controller does not read are refused."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

import surefoot as sf
from surefoot.run_plan import make_plan
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import CONTROLLERS
from surefoot.stabilizer.factory import check_read, make_controller, read_settings

SHORT = sf.Scenario(name="short", duration_s=0.4)
OWN = "tests/surefoot/own_controllers.py"


def _watch(monkeypatch: pytest.MonkeyPatch, seen: set[str]) -> None:
    """Note each setting that is read from now on."""
    for section in msgspec.structs.fields(ControllerSettings):
        keys = {field.name for field in msgspec.structs.fields(section.type)}

        def look(
            self: Any, name: str, section: str = section.name, keys: set[str] = keys
        ) -> Any:
            if name in keys:
                seen.add(f"{section}.{name}")
            return object.__getattribute__(self, name)

        monkeypatch.setattr(section.type, "__getattribute__", look)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_what_a_run_reads_is_what_its_controller_is_said_to_read(
    controller: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(SHORT, controller=controller)
    seen: set[str] = set()
    with monkeypatch.context() as patch:
        _watch(patch, seen)
        made = make_controller(controller, plan.robot, plan.settings)
        Simulation.of_plan(plan).run(made)
    said = read_settings(controller)
    assert seen <= said
    read, unread = (
        {name.partition(".")[0] for name in names} for names in (seen, said - seen)
    )
    assert unread <= read | {"whole_body"}  # a preset is read as it is resolved


def test_one_from_outside_may_read_whatever_it_is_given() -> None:
    assert read_settings(f"{OWN}:StayWithSettings") == {*setting_names()}
    given_none = read_settings(f"{OWN}:StayWithRobot")
    assert "safety.leave_s" in given_none
    assert "tsid.com_kp" not in given_none


@pytest.mark.parametrize("who", ["zmp", "hold", f"{OWN}:Stay"])
def test_a_setting_that_would_change_nothing_is_refused(who: str) -> None:
    with pytest.raises(FileFormatError, match=r"tsid\.com_kp: .*whole-body would"):
        make_plan(SHORT, controller=who, overrides=["tsid.com_kp=40"])
    with pytest.raises(FileFormatError, match="nothing"):
        sf.simulate("walker", SHORT, controller=who, settings={"tsid.com_kp": 40.0})


def test_of_several_controllers_one_that_reads_it_is_enough() -> None:
    check_read(["tsid.com_kp=40"], ["zmp", "whole-body"])
    with pytest.raises(FileFormatError, match="hold and zmp"):
        check_read(["tsid.com_kp=40"], ["zmp", "hold"])


def test_a_file_of_settings_is_for_any_controller() -> None:
    plan = make_plan(SHORT, controller="zmp", settings={"tsid": {"com_kp": 40.0}})
    assert plan.settings.tsid.com_kp == (40.0, 40.0, 40.0)


def test_a_study_is_refused_before_anything_is_run() -> None:
    with pytest.raises(FileFormatError, match="zmp"):
        sf.study("standing", controllers=["zmp-stock"], settings={"tsid.com_kp": 40.0})
