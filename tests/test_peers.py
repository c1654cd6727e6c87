"""The comparison with other libraries: its table, and (slow) the command."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import peers


def test_ratio_of_ten_pairs_leaves_one_out_at_either_end() -> None:
    theirs = [1.0] * 10
    ours = [float(i) for i in range(1, 11)]
    assert peers.ratio_of(ours, theirs) == (5.5, 2.0, 9.0)


def test_table_says_why_a_peer_is_missing() -> None:
    pairs = [{"whole tick": 300.0, "placo dynamics": 100.0, "placo kinematics": 50.0}]
    lines = peers.table_of(pairs, {"pink": "no wheel"}).splitlines()
    assert len(lines) == 2 + len(peers.COMPARISONS)
    assert "| 2.00 | 2.00 to 2.00 |" in lines[2]
    assert any("pink" in line and "not measured" not in line for line in lines)


@pytest.mark.slow
def test_command_writes_table_and_numbers(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.peers", "--quick", "--pairs", "1"]
    subprocess.run([*command, "--out", str(tmp_path)], check=True)
    (pair,) = json.loads((tmp_path / "peers.json").read_text())["pairs"]
    assert pair["whole tick"] > pair["floor"] > 0.0
    assert (tmp_path / "peers.md").read_text().startswith("| Surefoot")
