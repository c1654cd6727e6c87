"""Recorded ground in text files of other programs, whole and damaged."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from surefoot.schemas.motions import STANDARD_GRAVITY
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.recorded import recorded_track
from tests.sim_robot.ground_files import assert_refused, motion_of, read

KNET = """Origin Time       2026/11/26 12:00:00
{more}Sampling Freq(Hz) {rate}
Duration Time(s)  {lasts}
Dir.              E-W
Scale Factor      {scale}
Memo.
{rows}
"""
ROWS = "\n".join(8 * f"{count:9d}" for count in range(1, 26))  # two seconds


def _peer(*, units: str = "G", count: str = "4", step: str = ".5 SEC") -> str:
    return (
        "PEER STRONG MOTION DATABASE RECORD\nSynthetic\n"
        f"ACCELERATION TIME SERIES IN UNITS OF {units}\nNPTS= {count}, DT= {step}\n"
    )


def _knet(
    *,
    rate: str = "100Hz",
    lasts: str = "2",
    scale: str = "3920(gal)/1960",
    more: str = "",
    rows: str = ROWS,
) -> str:
    return KNET.format(rate=rate, lasts=lasts, scale=scale, more=more, rows=rows)


HEADING = "Time [s],Ax [m/s^2],Ay [m/s^2]\n"
COMMAS = "0,1,-1\n1,2,-2\n2,3,-3\n3,4,-4\n"


@pytest.mark.parametrize(
    ("text", "column", "values"),
    [
        (HEADING + COMMAS, "Ax", [1, 2, 3, 4]),
        (HEADING + COMMAS, "Ay [m/s^2]", [-1, -2, -3, -4]),
        ('"Time, s";"A x (m/s2)"\n0,0;0,5\n0,1;1\n0,2;1,5\n0,3;2\n', "A x", None),
        ("t\ta\n0,0\t0,5\n0,1\t1\n0,2\t1,5\n0,3\t2\n", "a", None),
        ("Time [s]  A [g]\n0 0.5\n 1   1.0\n2\t1.5 \n3 2\n", "A", None),
        ("# by hand\n# t, a, b\n" + COMMAS, "b", [-1, -2, -3, -4]),
        ("# t b a\n0 1 .5\n1 2 1\n2 3 1.5D0\n3 4 2\n", "a", None),
        ("# by hand\nt,a,b\n0,.5,\n1,1,2\n2,1.5,\n3,2,\n", "a", None),
        ("0;0,5;\n1;1;\n2;1,5;\n3;2;\n", "", None),
        ("0, 0.5,\n1, 1.0,\n2, 1.5,\n\n3, 2.0,\n", "", None),
        (",t,a\n0,0,.5\n1,1,1\n2,2,1.5\n3,3,2\n", "a", None),
        ("seconds,t_x\n0,.5\n1,1\n2,1.5\n3,2\n", "", None),
        ("n;time_s;a\n0;0;,5\n1;1;1\n2;2;1,5\n3;3;2\n", "", None),
        ('# "remark\n0.5,0.5\r\n1,1\r\n1.5,1.5\r\n2,2\r\n', "", None),
    ],
)
def test_columns_are_those_the_heading_names(
    tmp_path: Path, text: str, column: str, values: list[float] | None
) -> None:
    record = read(tmp_path / "a.csv", text, column=column)
    assert record.values.tolist() == (values or [0.5, 1.0, 1.5, 2.0])


@pytest.mark.parametrize(
    ("heading", "per_second", "units"),
    [
        ("t [ms],a [g]", 1e-3, "g"),
        ("time_ms,a (cm/s^2)", 1e-3, "cm/s2"),
        ('"Time, us","a [m/s²]"', 1e-6, "m/s2"),
        ("# Time (s) a [mm/s/s]", 1.0, "mm/s2"),
        ("t_rel,a_m_s2", 1.0, None),
        ("Time ms,a", 1e-3, None),
        ("timeMs,a", 1e-3, None),
        ("Milliseconds,a m/s^2", 1e-3, None),
        ("Time (seconds),a", 1.0, None),
        ("t_rel,a_rel", 1.0, None),
        ("t,a []", 1.0, None),
    ],
)
def test_units_that_a_heading_states_are_those_of_the_record(
    tmp_path: Path, heading: str, per_second: float, units: str | None
) -> None:
    between = " " if heading.startswith("#") else ","
    rows = "".join(f"{at}{between}{at * at}\n" for at in range(4))
    record = read(tmp_path / "a.csv", f"{heading}\n{rows}")
    assert record.times.tolist() == [per_second * at for at in range(4)]
    assert record.units == units


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        (",a,b", "does not tell which column has the times"),
        ("n,t,time", "does not tell which column has the times"),
        ("t,acc_g", r"units: missing, .*'acc_g' .* in g or"),
        ('t,"a, cm_s2"', r"units: missing, .* in cm/s2"),
        ("t,acc g", r"units: missing, .*'acc g' .* in g or"),
        ("t,acc-cm/s^2", r"units: missing, .* in cm/s2"),
        ("t,g", r"units: missing, .*'g' .* in g or"),
        ("t,accG", r"units: missing, .* in g or"),
        ("time_min,a", "times are in 'min', .* expected s, ms"),
    ],
)
def test_a_heading_that_may_mean_two_things_is_refused(
    tmp_path: Path, heading: str, words: str
) -> None:
    rows = "".join(f"{at},{at * at},1\n" for at in range(4))
    if heading.count(",") == 1 or '"' in heading:
        rows = rows.replace(",1\n", "\n")
    assert_refused(tmp_path / "a.csv", f"{heading}\n{rows}", words)
    if "units" in words:
        assert (
            read(tmp_path / "a.csv", f"{heading}\n{rows}", units="m/s2").units is None
        )


def test_units_that_nobody_knows_are_refused(tmp_path: Path) -> None:
    assert_refused(
        tmp_path / "a.csv", "t [days],a\n0,1\n", r"'days', .* expected s, ms"
    )
    path = tmp_path / "b.csv"
    path.write_text("t,a [mg]\n0,1\n1,2\n2,4\n3,8\n")
    with pytest.raises(ScenarioError, match=r"'mg', expected one of .* overrides"):
        recorded_track(motion_of(path, quantity="acceleration"))


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        (
            HEADING + "0,1,2\n0.50,,9\n",
            "Ax",
            r"line 3: Ax .* is nothing, expected a nu",
        ),
        (HEADING + "0,1,2\n1,2,3\n2,3,\n", "Ay", r"line 4: Ay .* is nothing"),
        (HEADING + "0,1,2\n1,2\n", "Ay", r"line 3: Ay .* is nothing"),
        (HEADING + "0,1,2\n,2,3\n", "Ay", r"line 3: time \[s\] is nothing"),
        ("t,a\n0,01,0,5\n", "a", "line 2: has 4 cells, expected 2; decimal commas"),
        ("0,1\n1,1_0\n", "", "line 2: column 2 is '1_0', expected a number"),
        ("0,1\n1,2\n2,3\n3.0", "", "line 4: column 2 is nothing, expected a number"),
        ("0,1\n1,NaN\n", "", "line 2: column 2 is 'NaN'"),
        (f"0,1\n1,{400 * '1'}\n", "", "line 2: column 2 is '1*[.]{3}'"),
        ("0;0,5\n1;1.5\n", "", "'1.5', expected a number with a decimal comma"),
        ('t,a\n0,1\n"1,2\n', "", "line 3: cannot be read as columns"),
        ("t [s],a [x],a [y]\n0,1,2\n", "a", r"names 2 such columns: t \[s\], a"),
        ("Time in s a b\n0 1 2\n", "a", "names no columns"),
        (COMMAS, "a", "names no columns"),
        ((HEADING + COMMAS).encode("utf-16"), "", "UTF-16 .* save it anew"),
        ((HEADING + COMMAS).encode("utf-16-le"), "", "UTF-16 .* save it anew"),
        (" \n", "", "is empty"),
    ],
)
def test_a_text_says_where_it_is_no_record(
    tmp_path: Path, text: str | bytes, column: str, words: str
) -> None:
    assert_refused(tmp_path / "a.csv", text, words, column=column)


@pytest.mark.parametrize(
    ("units", "understood"),
    [
        ("G", "g"),
        ("G.", "g"),
        ("(G)", "g"),
        ("g's, HORIZONTAL", "g"),
        ("GALS", "gal"),
        ("CM/SEC/SEC", "cm/s2"),
        ("CM/SEC2", "cm/s2"),
        ("CM/S/S", "cm/s2"),
        ("M/SEC**2", "m/s2"),
        ("M / SEC^2", "m/s2"),
        ("CM/SEC", "cm/s"),
    ],
)
def test_peers_many_ways_to_write_a_unit(
    tmp_path: Path, units: str, understood: str
) -> None:
    record = read(tmp_path / "a.AT2", _peer(units=units) + "1 2 3 4")
    assert record.units == understood


@pytest.mark.parametrize(
    ("words", "understood"),
    [
        ("IN UNITS: CM/S2", "cm/s2"),
        ("UNITS = M/S/S", "m/s2"),
        ("IN CM/SEC/SEC", "cm/s2"),
        ("(GAL)", "gal"),
        ("HISTORY", "g"),
    ],
)
def test_peers_unit_counts_wherever_the_heading_has_it(
    tmp_path: Path, words: str, understood: str
) -> None:
    text = _peer().replace("IN UNITS OF G", words) + "1 2 3 4"
    assert read(tmp_path / "a.AT2", text).units == understood


@pytest.mark.parametrize(
    ("step", "step_s"),
    [(".5 SEC", 0.5), ("1.0D-2", 0.01), ("10 MSEC", 0.01), ("0.01SEC,", 0.01)],
)
def test_peers_step_and_touching_fields(
    tmp_path: Path, step: str, step_s: float
) -> None:
    body = "-1.234E-01-5.678E-02\n 1.0D-2\n.5-.25"
    head = _peer(step=step, count="5")
    turned = re.sub(r"(NPTS=.*?), (DT=.*)", r"\2, \1", head)
    for text in (head + body, turned + body):
        record = read(tmp_path / "a.AT2", text)
        assert record.values.tolist() == [-0.1234, -0.05678, 0.01, 0.5, -0.25]
        assert record.times[1] == pytest.approx(step_s)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_peer(step="..05") + "1 2 3 4", "DT is '..05', expected a number above 0"),
        (_peer(step="1.2.3") + "1 2 3 4", "DT is '1.2.3'"),
        (_peer(step="0") + "1 2 3 4", "DT is '0', expected a number above 0"),
        (_peer(step="1 HOURS") + "1 2 3 4", "DT is '1 HOURS', expected seconds"),
        (_peer(count=5000 * "9") + "1 2 3 4", "NPTS is '9*[.]{3}', expected a number"),
        (_peer(count="5") + "1 2 3 4", "holds 4 values and its heading says 5"),
        (_peer() + "1 2 3\n4 5 6\n7", "holds 7 values and its heading says 4"),
        (_peer() + "1 2\n3 1.5-101", "line 6: a value is '1.5-101'"),
        ("nothing\nof\nthe\nkind\n1 2", "do not say NPTS"),
    ],
)
def test_peer_refused(tmp_path: Path, text: str, words: str) -> None:
    assert_refused(tmp_path / "a.AT2", text, words)


def test_units_of_the_scenario_override_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.AT2"
    path.write_text(_peer(units="FURLONGS", step=".01") + "0 1 -1 0")
    with pytest.raises(ScenarioError, match=r"furlongs.*a.AT2 says.*overrides"):
        recorded_track(motion_of(path))
    assert recorded_track(motion_of(path, units="cm/s2", drift_hz=0.0)) is not None


NUMBERS = 25 * "0 1 2 3 0 -1 -2 -3 "


@pytest.mark.parametrize(
    ("text", "gals"),
    [
        (_peer(units="G", step=".01", count="200") + NUMBERS, 100.0 * STANDARD_GRAVITY),
        (_peer(units="M/SEC2", step=".01", count="200") + NUMBERS, 100.0),
        (_knet(scale="2(gal)/4", rows=NUMBERS), 0.5),
    ],
)
def test_ground_moves_in_the_units_of_its_record(
    tmp_path: Path, text: str, gals: float
) -> None:
    positions = []
    for content in (text, _peer(units="GAL", step=".01", count="200") + NUMBERS):
        path = tmp_path / ("a.EW" if content.startswith("Origin") else "a.AT2")
        path.write_text(content)
        positions.append(recorded_track(motion_of(path, drift_hz=0.0)).position)
    np.testing.assert_allclose(positions[0], gals * positions[1], atol=1e-9)


@pytest.mark.parametrize("before", ["", "\ufeff", "\n", "\ufeff \r\n"])
@pytest.mark.parametrize("more", ["", "Lat. 1\nLong. 2\n"])
def test_knet_is_told_by_its_content(tmp_path: Path, before: str, more: str) -> None:
    record = read(tmp_path / "a.EW", before + _knet(more=more))
    assert record.values[:9].tolist() == [2.0] * 8 + [4.0]
    assert len(record.times) == 200
    assert record.times[-1] == pytest.approx(1.99)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"rate": "..Hz"}, "Sampling Freq.* is '..', expected a number above 0"),
        ({"scale": "..(gal)/6182761"}, "Scale Factor is '..'"),
        ({"scale": "1.2.3(gal)/6182761"}, "Scale Factor is '1.2.3'"),
        ({"scale": "3920(gal)/0"}, "Scale Factor is '0', expected a number above 0"),
        ({"lasts": "3"}, "holds 200 values and its heading says 300; it was cut"),
        ({"lasts": "1"}, "holds 200 values and its heading says 100; one of the two"),
        ({"rows": "1 x 2"}, "line 7: a value is 'x'"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_knet_refused(tmp_path: Path, keys: dict[str, str], words: str) -> None:
    assert_refused(tmp_path / "a.EW", _knet(**keys), words)


TENTHS = [0.1 * index for index in range(100)]


@pytest.mark.parametrize(
    ("times", "keys", "key", "words"),
    [
        ([1e5 * t for t in TENTHS], {}, "file", "at most 3600; .* in seconds"),
        ([1e9 * t for t in TENTHS], {}, "file", "at most 3600; .* in seconds"),
        (TENTHS, {"drift_hz": 5.0}, "drift_hz", "got 5, .* less than 5 Hz, half"),
        (TENTHS, {"drift_hz": 600.0}, "drift_hz", "less than 5 Hz, half"),
        (TENTHS, {"drift_hz": 1e-9}, "drift_hz", "got 1e-09, expected 0 .* from 0.001"),
        (TENTHS, {"from_s": 100.0}, "from_s", "got 100 s, but .* ends after 9.9 s"),
        (TENTHS[:50] + TENTHS[60:], {}, "file", "from 4.9 s to 6 s, expected one abo"),
        (
            TENTHS + [10.0 + index / 4000.0 for index in range(40)],
            {},
            "file",
            "has 4000 samples a second at 10",
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_times_no_ground_can_follow(
    tmp_path: Path, times: list[float], keys: dict[str, float], key: str, words: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{time!r},0.1\n" for time in times))
    with pytest.raises(ScenarioError, match=words) as caught:
        recorded_track(motion_of(path, quantity="velocity", **keys))
    assert caught.value.field == key


def test_a_piece_beside_a_gap_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{t!r},{t!r}\n" for t in TENTHS[:50] + TENTHS[60:]))
    track = recorded_track(motion_of(path, quantity="position", to_s=4.0))
    assert len(track.position) == 4001


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_what_is_fast_is_not_weakened(tmp_path: Path, quantity: str) -> None:
    times = np.arange(501) / 50.0
    wave = np.sin(math.tau * 10.0 * times)
    path = tmp_path / "a.csv"
    path.write_text(
        "".join(f"{t:.9f},{v:.9f}\n" for t, v in zip(times, wave, strict=True))
    )
    track = recorded_track(motion_of(path, quantity=quantity, drift_hz=0.0))
    middle = getattr(track, quantity)[2000:8000]
    assert math.sqrt(2.0) * middle.std() == pytest.approx(1.0, abs=0.03)
