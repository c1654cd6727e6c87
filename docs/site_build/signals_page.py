"""Reference of the signals of a run, from their table."""

from __future__ import annotations

from surefoot.schemas.signals import (
    JOINTS,
    MISSING,
    PLATFORMS,
    SIGNALS,
    KnownBy,
    Signal,
    lay_out,
)

_HEAD = f"""# Signals

What is known of a run at every tick, by name, written from the table
[`schemas/signals.py`](../../schemas/signals.py#SIGNALS). The names are the same in
memory, in the ticks files, in their exports and in reports.

```python
import surefoot as sf

run = sf.simulate("walker", "moving-platform-fast")  # or sf.load_run("out/fast")
run.signals["F_meas"][:, 2]  # (ticks,) measured normal force on the left sole [N]
run.signals.time_s  # (ticks,) [s]
print(run.signals.describe())  # name, shape, unit, frame, columns, meaning
```

- The first axis are the ticks. In tables (CSV, Parquet) each number has a column of its
  own, signal and label joined by a dot: `F_id.f_z_left`, `q.left_knee`,
  `true_platform_pose.platform_0.z`; a signal of one number is its name alone.
- Only signals that begin with `true_` are the simulator's; a robot knows nothing of
  them. `F_meas` and `true_F` have the same columns, and so have `base_pose` and
  `true_base_pose`, which differ by their frame.
- A signal that its controller does not tell is not there. Where a tick has no answer,
  the controller's signals are NaN, or {MISSING} for whole numbers, and empty in CSV.
- Unit 1 stands for a number without one. A wrench is [force; moment], of the ground on
  the robot; a twist [linear; angular]; quaternions are x y z w. The frame `stance`
  stands midway between the soles. A joint signal has a column per joint, in the order
  of the robot file.
"""
_GROUPS = {
    KnownBy.CLOCK: ("Time", "What the clocks say."),
    KnownBy.ROBOT: ("Robot", "Sensors as the robot reports them, and its command."),
    KnownBy.CONTROLLER: ("Controller", "What it estimates, wants and answers."),
    KnownBy.SIMULATOR: ("Truth", "What the simulator alone knows."),
}
_SHOWN = 7


def signals_page() -> str:
    """Markdown with a table for each who knows."""
    parts = [_HEAD]
    for known_by, (title, words) in _GROUPS.items():
        rows = [_row(signal) for signal in SIGNALS if signal.known_by is known_by]
        parts.append(
            f"## {title}\n\n{words}\n\n"
            "| signal | shape | unit | frame | columns | meaning |\n"
            "|---|---|---|---|---|---|\n" + "\n".join(rows)
        )
    return "\n".join([*parts, _words()]) + "\n"


def _row(signal: Signal) -> str:
    layout = lay_out(signal.name, joints=["a joint"], platforms=1)
    last = signal.axes[-1] if signal.axes else ()
    labels = ["joint names"] if last == JOINTS else [f"`{label}`" for label in last]
    if len(labels) > _SHOWN:
        labels = [*labels[:_SHOWN], "..."]
    if PLATFORMS in signal.axes:
        labels = ["`platform_0`, ... with", *labels]
    sizes = [axis if isinstance(axis, str) else str(len(axis)) for axis in signal.axes]
    shape = ", ".join(["ticks", *sizes])
    return (
        f"| `{signal.name}` | ({shape}) | {layout.unit} | {signal.frame} | "
        f"{' '.join(labels)} | {signal.meaning} |"
    )


def _words() -> str:
    lines = ["\n## Words\n\nWhat whole numbers stand for.\n"]
    for signal in SIGNALS:
        if signal.words:
            words = ", ".join(f"{n} {word}" for n, word in enumerate(signal.words))
            lines.append(f"- `{signal.name}`: {words}")
    return "\n".join(lines)
