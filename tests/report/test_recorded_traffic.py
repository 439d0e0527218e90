"""The report of recorded traffic, whose table of the truth says what was recorded."""

from __future__ import annotations

import trackbench as tb


def test_what_was_recorded_and_what_smoothing_took_are_told() -> None:
    loaded = tb.load("recorded/i80", {"expect": []}, runs=1, trackers=["ekf_cv"])
    text = str(tb.run(loaded, in_process=True).report())
    assert "acceleration as recorded" in text
    assert "noise of the recording" in text
