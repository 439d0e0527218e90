"""The table of what the statistics claim, made by ``make calibration``."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration import subjects
from benchmarks.calibration.claim import rate

#: What does not hold, with which results/calibration.md begins; the last two are beyond what is
#: wanted by less than their own error.
FAILING = {
    "scenes of intersection, 120, imm_three, mean squared velocity error",
    "highway, 10 scenes, position RMSE: the same of the tracker covered least",
    "highway, 5 scenes, velocity RMSE: interval covers, mean over 6 trackers",
    "matched filter, 10 runs of scenes with correlated errors: consistent",
    "matched filter, 20 runs of scenes with correlated errors: consistent",
    "1 runs, autocorrelation 1, NEES 4.4: called wrong from few runs",
    "scripted/own_model, one run of 21 s: of two equal versions one is called better",
}


def test_every_subject_has_its_claims_in_the_committed_table_and_all_hold_but_what_is_said_not_to() -> None:
    found = subjects.load()
    assert list(found) == subjects.subjects()
    assert {claim.what for claims in found.values() for claim in claims if not claim.holds} == FAILING


def test_the_committed_table_shows_the_committed_data(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = subjects.load()
    committed = (subjects.RESULTS / "calibration.md").read_text(encoding="utf-8")
    monkeypatch.setattr(subjects, "RESULTS", tmp_path)
    subjects.save(found)
    assert (tmp_path / "calibration.md").read_text(encoding="utf-8") == committed
    assert subjects.load() == found


def test_a_rate_holds_between_its_limits_and_states_its_own_error() -> None:
    hits = np.arange(1000) < 940
    assert rate("x", hits, 0.93, 0.97).holds
    assert not rate("x", hits, 0.0, 0.05).holds
    assert rate("x", hits, 0.93, 0.97)[1:3] == ("94.0 ± 1.5 % of 1,000", "93 to 97 %")
    assert rate("x", ~hits, 0.0, 0.05).wanted == "at most 5 %"
    assert rate("x", hits, 0.95, 1.0).wanted == "at least 95 %"
