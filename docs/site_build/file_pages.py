"""References of the files users write, and of what a run reports."""

from __future__ import annotations

from inspect import cleandoc
from pathlib import Path

import msgspec

from docs.site_build.struct_table import field_rows, literals, table
from surefoot.schemas.endpoints import DEFAULT_LOCATOR, Endpoints
from surefoot.schemas.json_schema import structs_within
from surefoot.schemas.result import RunResult
from surefoot.schemas.robot_file import RobotFile
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_paths import scenario_paths
from surefoot.schemas.toml_file import load
from surefoot.sim_robot.catalogue import SCENARIOS_DIR, list_scenarios

ROOT = Path(__file__).resolve().parents[2]

_COLUMNS = ("name", "type", "default", "unit", "range", "text")


def scenario_page() -> str:
    """Scenario file: keys, and the scenarios that ship."""
    head = """# Scenario file

What the world does to the robot, in TOML. A misspelt key is refused by its path, with
the nearest valid one. The shortest one is a name and a duration; start from a
[shipped one](../../sim_robot/scenarios):

"""
    lines = ["\n## Shipped scenarios\n", "| name | lasts | what |", "|---|---|---|"]
    for name in list_scenarios():
        scenario = load(SCENARIOS_DIR / f"{name}.toml", Scenario)
        link = f"[`{name}`](../../sim_robot/scenarios/{name}.toml)"
        lines.append(f"| {link} | {scenario.duration_s:g} s | {scenario.description} |")
    return (
        head
        + _example(SCENARIOS_DIR / "push-slow-platform.toml")
        + _tables(Scenario)
        + "\n".join(lines)
        + "\n"
        + _paths()
    )


def robot_page() -> str:
    """Robot file: keys."""
    head = """# Robot file

A TOML beside a URDF: what the URDF has no words for. The URDF gives geometry, inertia,
joint ranges and torque limits; files that contradict each other are refused. A file
that says `extends = "other.toml"` changes only what it names. [Robots](../robots.md)
tells of the Walker and where its numbers are from. The same robot with the names of its
real bus:

"""
    folder = "walker-real"
    path = ROOT / "robot_io/robots" / folder / f"{folder}.toml"
    return head + _example(path) + _tables(RobotFile)


def endpoint_page() -> str:
    """Endpoint file: keys."""
    head = f"""# Endpoint file

Where a process meets the others on the network, and as whom; given with
`--endpoints FILE`. Without one, everything is on `{DEFAULT_LOCATOR}`. Who may do what
is told in [Security](../security.md); ready files are in
[`deploy/hardware`](../../deploy/hardware).

"""
    path = ROOT / "deploy/hardware/stabilizer.toml"
    return head + _example(path) + _tables(Endpoints)


def results_page() -> str:
    """What ``surefoot run`` reports."""
    head = """# Results

What `surefoot run --json` prints and `--out DIR` keeps as `result.json`. A folder of a
run holds besides: `ticks.mcap` and `controller-ticks.mcap`
([signals of every tick](signals.md)), `run.mcap`
([every message](../recording.md)), `settings.toml` and `scenario.toml` (as resolved),
and a log per process.

`log_sha256` is over every tick's sensors and commands, never over timings: two lockstep
runs of the same code, scenario, seed and settings have the same one, however busy the
machine is.

"""
    return head + _tables(RunResult)


def _tables(kind: type[msgspec.Struct]) -> str:
    parts = []
    for struct, head in structs_within(kind).items():
        is_toml = head and kind is not RunResult
        title = f"{struct.__name__}: `{head}`" if is_toml else struct.__name__
        tag = struct.__struct_config__.tag
        words = f' Written with `kind = "{tag}"`.' if tag else ""
        parts.append(
            f"\n## {title}\n\n{_whole_doc(struct)}{words}\n\n"
            + table(field_rows(struct), _COLUMNS)
        )
    return "".join(parts)


def _whole_doc(struct: type[msgspec.Struct]) -> str:
    return literals(cleandoc(struct.__doc__ or ""))


def _example(path: Path) -> str:
    return f"```toml\n{path.read_text(encoding='utf-8').strip()}\n```\n"


def _paths() -> str:
    scenario = load(SCENARIOS_DIR / "push-slow-platform.toml", Scenario)
    paths = "\n".join(f"- `{path}`" for path in scenario_paths(scenario))
    return f"""
## Values by path

`surefoot sweep --vary PATH=...` varies a value by its path, and some paths stand for
several keys: the impulse of a push, a peak rate. Those of `push-slow-platform`:

{paths}
"""
