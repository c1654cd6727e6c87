from __future__ import annotations

import numpy as np

from surefoot.recording.read import ChannelCount


def test_every_number_left_out_between_first_and_last_is_counted() -> None:
    rng = np.random.default_rng(3)
    kept = np.flatnonzero(rng.random(5000) < 0.9)
    count = ChannelCount(channel="joints", counted_by="tick")
    for number in kept:
        count.add(int(number))
    assert count.messages == len(kept)
    assert count.missing == kept[-1] - kept[0] + 1 - len(kept)
    assert count.gaps == np.count_nonzero(np.diff(kept) > 1)
    assert count.restarts == 0


def test_a_count_that_begins_anew_is_a_restart_and_no_gap() -> None:
    count = ChannelCount(channel="joint_command", counted_by="sequence")
    for number in (5, 6, 0, 1):
        count.add(number)
    count.add(40, is_new_sender=True)
    assert (count.missing, count.gaps, count.restarts) == (0, 0, 2)
