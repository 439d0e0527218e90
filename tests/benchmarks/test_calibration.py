"""The table of what the statistics claim, made by ``make calibration``."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration import subjects
from benchmarks.calibration.claim import FAILS, HOLDS, STATED, UNDECIDED, Claim, power, rate

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


def test_a_rate_is_decided_where_no_limit_is_within_its_own_error() -> None:
    hits = np.arange(1000) < 945
    assert rate("x", hits, 0.93, 0.97).outcome == HOLDS
    assert rate("x", hits, 0.94, 1.0).outcome == UNDECIDED
    assert rate("x", hits, 0.95, 1.0).outcome == UNDECIDED
    assert rate("x", hits, 0.96, 1.0).outcome == FAILS
    # None of thirty says little of one in twenty.
    assert rate("x", np.zeros(30), 0.0, 0.05).outcome == UNDECIDED
    assert rate("x", np.zeros(100), 0.0, 0.05).outcome == HOLDS
    assert power("x", hits).outcome == STATED


def test_the_table_counts_what_holds_what_fails_what_is_undecided_and_what_is_stated(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hits = np.arange(1000) < 945
    claims = [rate("a", hits, 0.93, 0.97), rate("b", hits, 0.96, 1.0), rate("c", hits, 0.95, 1.0), power("d", hits)]
    monkeypatch.setattr(subjects, "RESULTS", tmp_path)
    subjects.save({"tails": claims})
    text = (tmp_path / "calibration.md").read_text(encoding="utf-8")
    assert "3 claims: 1 hold, 1 do not;\n1 are not decided by so many repeats." in text
    assert "every claim, and 1 numbers that are only stated, are in" in text
    assert "Does not hold: tails, b (" in text
    assert "Not decided, and measured beyond what is wanted: tails, c (" in text
    assert "| b | 94.5 ± 1.4 % of 1,000 | at least 96 % | **fails** | 1 |" in text
    assert "power: d" not in text
    assert subjects.load() == {"tails": [claim if claim.excess is None else rounded(claim) for claim in claims]}


def rounded(claim: Claim) -> Claim:
    return claim._replace(excess=round(claim.excess or 0.0, 4))


def test_the_worst_of_a_family_fails_or_is_undecided_or_comes_nearest_to_its_limit() -> None:
    hits = {share: np.arange(10_000) < 10_000 * share for share in (0.0, 0.02, 0.045, 0.049, 0.07, 0.09)}
    kept = [rate(f"{share}", hits[share], 0.0, 0.05) for share in (0.0, 0.045, 0.02)]
    (worst,) = subjects.worst_of_families(kept)
    assert worst == (kept[1], 3)
    undecided = rate("undecided", hits[0.049], 0.0, 0.05)
    assert undecided.outcome == UNDECIDED
    assert subjects.worst_of_families([undecided, *kept]) == [(undecided, 4)]
    failing = [rate(f"{share}", hits[share], 0.0, 0.05) for share in (0.07, 0.09)]
    assert subjects.worst_of_families([*failing, undecided, *kept]) == [(failing[1], 6)]
    least = [rate(f"{share}", ~hits[share], 0.9, 1.0) for share in (0.0, 0.07, 0.02)]
    assert subjects.worst_of_families([*kept, *least, power("x", hits[0.09])]) == [(kept[1], 3), (least[1], 3)]


def test_every_excess_of_the_committed_table_has_the_sign_of_its_outcome() -> None:
    claims = [claim for claims in subjects.load().values() for claim in claims if claim.wanted != STATED]
    known = [claim for claim in claims if claim.excess is not None]
    assert len(known) > 0.9 * len(claims)
    # Digits that are not printed decide of one claim.
    assert [claim.what for claim in known if (claim.excess > 0) == claim.holds and claim.excess] == []
