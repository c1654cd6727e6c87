"""Options that several commands share, and their completion in a shell."""

from __future__ import annotations

import inspect
import math
import re
import shutil
from os.path import expanduser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from surefoot.errors import UsageError

if TYPE_CHECKING:
    from surefoot.robot_io.robot import Robot
    from surefoot.schemas.endpoints import Endpoints

_SUFFIX = ".toml"
NARROW = 72
"""Columns below which a table of options would cut their names."""
_HOME = re.compile(r"^(--[a-z-]+=|)(~[^/]*)")
"""A home folder (``~``) at the beginning of a word or of an option's value."""
_WORDS = {"str": "TEXT", "path": "PATH", "int": "N", "int range": "N", "float": "X"}
MOST_SEED = 2**62
_WANTED = {
    "DIR": "a folder",
    "RUN_DIR": "a folder",
    "FILE": "a file",
    "PATH": "a file or folder",
}
"""What to name, by the word for the value in help."""
_PRESETS = Path(__file__).parents[1] / "stabilizer" / "presets"
_SHIPPED = sorted(path.stem for path in _PRESETS.glob("*.toml"))
"""Names of the shipped settings; found here since help must not load the stabilizer."""
_BUS = "Bus"
CONTROLLER = "Controller"
_TIMING = "Real time"


def complete_scenario(incomplete: str) -> list[str]:
    """Return shipped scenarios and scenario files that begin like this."""
    from surefoot.sim_robot.catalogue import list_scenarios

    names = [name for name in list_scenarios() if name.startswith(incomplete)]
    return names + _files(incomplete)


def complete_channel(incomplete: str) -> list[tuple[str, str]]:
    """Return channels that can be listened to, with their descriptions."""
    from surefoot.schemas.topics import PUBLISHED

    return [
        (entry.name, entry.description)
        for entry in PUBLISHED
        if entry.name.startswith(incomplete)
    ]


def complete_robot(incomplete: str) -> list[str]:
    """Return shipped robots and robot files that begin like this."""
    from surefoot.robot_io.robot import list_robots

    names = [name for name in list_robots() if name.startswith(incomplete)]
    return names + _files(incomplete)


def complete_controller(incomplete: str) -> list[str]:
    """Return shipped and installed controllers that begin like this."""
    from surefoot.stabilizer.foreign import list_controllers

    return [name for name in list_controllers() if name.startswith(incomplete)]


def complete_setting(incomplete: str) -> list[str]:
    """Return settings for ``--set`` that begin like this, with the equals sign."""
    from surefoot.schemas.settings import setting_names

    known = (f"{name}=" for name in setting_names())
    return [name for name in known if name.startswith(incomplete)]


def _files(incomplete: str) -> list[str]:
    """Return TOML files and folders that begin like this; none if unreadable."""
    folder = Path(incomplete) if incomplete.endswith("/") else Path(incomplete).parent
    prefix = "" if str(folder) == "." and not incomplete.startswith("./") else folder
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return []
    paths = [
        f"{Path(prefix, path.name)}{'/' if path.is_dir() else ''}"
        for path in found
        if path.is_dir() or path.suffix == _SUFFIX
    ]
    return [path for path in paths if path.startswith(incomplete)]


class _TerminalWords:
    """Shows values in help as ``TEXT``, ``PATH`` or ``N``, not as Python types.

    A mixin that stands before a class of Typer's, which a type checker cannot know.
    """

    rich_markup_mode: Any

    def get_params(self, ctx: Any) -> list[Any]:
        """Return all parameters; those without a word for their value get one."""
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]  # typer is untyped here
        for param in params:
            if isinstance(param, TyperArgument):
                param.metavar = param.metavar or str(param.name).upper()
                param.display_type_rich = _nothing  # type: ignore[method-assign]  # one object's
            elif param.metavar is None and param.is_flag:
                param.metavar = ""
            elif param.metavar is None:
                kind = re.sub(r"^<(?:list\[)?|\]?>$", "", param.display_type(ctx))
                param.metavar = _WORDS.get(kind, kind)
        return params

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words after the command's name, without braces."""
        words: list[str] = super().collect_usage_pieces(ctx)  # type: ignore[misc]  # as above
        return [re.sub(r"[{}]", "", word) for word in words]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help; in a narrow terminal without boxes, which would cut the names."""
        if shutil.get_terminal_size().columns < NARROW:
            self.rich_markup_mode = None
        super().format_help(ctx, formatter)  # type: ignore[misc]  # as above


class Command(_TerminalWords, TyperCommand):
    """A command of ``surefoot``."""

    def __init__(self, *args: Any, help: str | None = None, **more: Any) -> None:
        """Join the lines of each paragraph, since the terminal wraps them."""
        if help is not None:
            help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(help))
        super().__init__(*args, help=help, **more)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words, with ``~`` in ``--out=~/x`` expanded.

        Raises:
            UsageError: a text is empty, or a number out of range or none.
        """
        args = [_HOME.sub(lambda at: at[1] + expanduser(at[2]), arg) for arg in args]
        if not ctx.resilient_parsing:
            given = self.make_parser(ctx).parse_args([*args])[0]
            for param in self.get_params(ctx):
                texts = given.get(param.name)
                for text in texts if isinstance(texts, (list, tuple)) else [texts]:
                    if isinstance(text, str):
                        _check_text(text, param, kind=param.display_type(ctx))
        parsed: list[str] = super().parse_args(ctx, args)
        return parsed


def _check_text(text: str, param: Any, *, kind: str) -> None:
    """Refuse an empty value, and a number that typer would refuse without naming it."""
    is_argument = isinstance(param, TyperArgument)
    name = param.metavar if is_argument else max(param.opts, key=len)
    if not text.strip():
        wanted = _WANTED.get(param.metavar, "one" if is_argument else "a value")
        raise UsageError(
            f"{name}: is empty; name {wanted} (a shell variable that is not set is "
            "empty)"
        )
    if "float" not in kind and "int" not in kind:
        return
    is_whole = "int" in kind
    least, most = getattr(param, "min", None), getattr(param, "max", None)
    try:
        number = int(text) if is_whole else float(text)
        is_fit = math.isfinite(number)
    except (ValueError, OverflowError):
        number, is_fit = 0, False
    is_low = least is not None and number < least
    is_high = most is not None and number > most
    if is_fit and not is_low and not is_high:
        return
    expected = "a whole number" if is_whole else "a finite number"
    if least is not None:
        expected += " of at least" if most is None else " from"
        expected += f" {least:.12g}"
    if most is not None:
        expected += f" to {most:.12g}"
    raise UsageError(f"{name}: got {text!s}, expected {expected}")


class Group(_TerminalWords, TyperGroup):
    """A command with subcommands."""


def _nothing(ctx: Any) -> None:
    """Show no type for an argument: its name in capitals is enough."""
    del ctx


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Shipped scenario, or a scenario file (.toml).",
        autocompletion=complete_scenario,
    ),
]

RobotOption = Annotated[
    str,
    typer.Option(
        "--robot",
        help="Shipped robot, or a robot file (.toml).",
        autocompletion=complete_robot,
    ),
]


@overload
def names_in(text: str) -> list[str]: ...
@overload
def names_in(text: None) -> None: ...
def names_in(text: str | None) -> list[str] | None:
    """Return the names of a comma-separated list without blanks; None stays None."""
    return None if text is None else [name.strip() for name in text.split(",")]


WaitOption = Annotated[
    float,
    typer.Option(
        "--wait",
        min=0.0,
        metavar="SECONDS",
        help="How long to wait for the robot.",
    ),
]

ServoOption = Annotated[
    str | None,
    typer.Option(
        "--servo-profile",
        help="Servo profile of the robot file; the file's own choice when absent.",
    ),
]

SeedOption = Annotated[
    int,
    typer.Option("--seed", min=0, max=MOST_SEED, help="Seed of the sensor noise."),
]

LockstepOption = Annotated[
    bool,
    typer.Option(
        "--lockstep/--realtime",
        help="Lockstep: the robot waits for each command, and the same run is the same "
        "bit for bit. Real time: it keeps its own pace, as hardware does.",
    ),
]

ControllerOption = Annotated[
    str,
    typer.Option(
        "--controller",
        metavar="NAME",
        help="Control law: whole-body, zmp, hold, an installed one, or your own as "
        "package.module:Class or path/to/file.py:Class.",
        autocompletion=complete_controller,
        rich_help_panel=CONTROLLER,
    ),
]

SettingsOption = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        metavar="FILE",
        help=f"Shipped settings ({', '.join(_SHIPPED)}), or a file (.toml) with any of "
        "the settings.",
        rich_help_panel=CONTROLLER,
    ),
]

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override one setting, such as tsid.base_kp=120. May be repeated.",
        autocompletion=complete_setting,
        rich_help_panel=CONTROLLER,
    ),
]

EndpointsOption = Annotated[
    Path | None,
    typer.Option(
        "--endpoints",
        metavar="FILE",
        help="File (.toml) that says where robot and others meet.",
        rich_help_panel=_BUS,
    ),
]


def locators_option(flag: str, help: str) -> Any:
    """Return an option for network locators."""
    return typer.Option(
        flag,
        metavar="LOCATOR",
        help=f"{help} May be repeated.",
        rich_help_panel=_BUS,
    )


ListenOption = Annotated[
    list[str] | None,
    locators_option("--listen", "The robot listens here, such as tcp/127.0.0.1:7447."),
]
ConnectOption = Annotated[
    list[str] | None, locators_option("--connect", "Dial the robot here.")
]
RouterOption = Annotated[
    list[str] | None,
    locators_option("--router", "Dial a router here instead of listening."),
]

InsecureOption = Annotated[
    bool,
    typer.Option(
        "--insecure",
        help="Listen on other addresses than loopback without TLS: anyone on that "
        "network can then command the robot.",
        rich_help_panel=_BUS,
    ),
]

JobsOption = Annotated[
    int, typer.Option("--jobs", min=0, help="Processes; 0 for one per processor.")
]

SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Run on the workers of this Dask scheduler, such as tcp://head:8786.",
    ),
]


HistogramOption = Annotated[
    bool,
    typer.Option(
        "--histogram",
        help="Show histograms of the loop's times; with --json as data.",
        rich_help_panel=_TIMING,
    ),
]

CpuOption = Annotated[
    int | None,
    typer.Option(
        "--cpu",
        min=0,
        metavar="N",
        help="Keep this process on processor N.",
        rich_help_panel=_TIMING,
    ),
]

PriorityOption = Annotated[
    int | None,
    typer.Option(
        "--realtime-priority",
        min=1,
        max=99,
        metavar="P",
        help="Run before all ordinary processes (SCHED_FIFO at priority P). Needs the "
        "permission; without it the run continues at normal priority.",
        rich_help_panel=_TIMING,
    ),
]

OverwriteOption = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace files that this command wrote there before; others stay.",
    ),
]

OpenOption = Annotated[
    bool, typer.Option("--open", help="Open the page in the web browser.")
]

JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object on stdout and nothing else."),
]

ChildOption = Annotated[bool, typer.Option("--child", hidden=True)]

ResultFileOption = Annotated[Path | None, typer.Option("--result-file", hidden=True)]

RecordFileOption = Annotated[Path | None, typer.Option("--record-file", hidden=True)]


def check_priority(priority: int | None, *, lockstep: bool) -> None:
    """Refuse a real-time priority in lockstep, where the loop never rests.

    Raises:
        UsageError: nothing else could run on its processor.
    """
    if priority is not None and lockstep:
        raise UsageError(
            "--realtime-priority goes with --realtime; in lockstep the two processes "
            "never rest, and nothing else would run"
        )


def claim_processor(*, cpu: int | None, priority: int | None) -> None:
    """Pin this process and set its priority; only log it if not permitted.

    Call it before any thread starts: threads inherit both.
    """
    from surefoot.robot_io.realtime import pin_to_cpu, take_priority

    if cpu is not None:
        _tell(pin_to_cpu(cpu), f"on processor {cpu}")
    if priority is not None:
        _tell(take_priority(priority), f"SCHED_FIFO at priority {priority}")


def dialed(
    robot: str,
    servo_profile: str | None,
    endpoints: Path | None,
    connect: list[str] | None,
) -> tuple[Robot, Endpoints]:
    """Return the robot of these options, and the endpoints to dial it."""
    from surefoot.robot_io.robot import load_robot
    from surefoot.schemas.endpoints import choose_endpoints

    model = load_robot(robot, servo_profile=servo_profile)
    return model, choose_endpoints(endpoints, connect=connect)


def _tell(refusal: str, done: str) -> None:
    from surefoot.processes.child import log_note, log_warning

    if refusal:
        log_warning(refusal)
    else:
        log_note(done)
