"""The mode probabilities of trackers with several motion models, from the estimate to the pages."""

from pathlib import Path

import numpy as np
import pytest
from tests.trackers.test_imm_tracker import SCENARIO

import trackbench as tb
from trackbench.results.columns import split

MINE = '''
import numpy as np
import trackbench as tb

class Mine:
    """The first measurement for ever."""

    batched = {batched}

    def step(self, state, scan):
        position = scan.measurement if state is None else np.where(np.isnan(state), scan.measurement, state)
        batch = position.shape[1:]
        covariance = np.zeros((4, 4, *batch)) + np.eye(4).reshape(4, 4, *(1 for _ in batch))
        mean = np.concatenate([position, np.zeros_like(position)])
        return position, tb.Estimate(mean, covariance, mode_probabilities=np.stack({probabilities}))
'''


def of(tmp_path: Path, code: str | None = None, runs: int = 3) -> tb.Result:
    path = tmp_path / "bend.yaml"
    path.write_text(SCENARIO)
    changes = {"truth.objects.car.pieces": [{"for_s": 2}], "truth.duration_s": 2}
    if code is None:
        changes |= {"trackers.imm.initial": "two_measurements", "score.settle_s": 0.2}
    else:
        (tmp_path / "mine.py").write_text(code)
        changes |= {"trackers": {"mine": {"use": "mine:Mine"}}, "score.settle_s": 0}
    return tb.run(tb.load(path, changes, runs=runs))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> tb.Result:
    return of(tmp_path_factory.mktemp("modes"))


def test_the_tables_hold_probabilities_of_each_mode(result):
    single = split(result.tables.recorded_modes, "tracker", "mode", "object")
    assert list(single) == [("imm", "cv", "car"), ("imm", "ctrv", "car")]
    cv, ctrv = (rows["probability"] for rows in single.values())
    known = np.isfinite(cv)
    start = np.argmax(known)
    assert 0 < start < len(known) / 2
    assert known[start:].all()
    np.testing.assert_allclose((cv + ctrv)[known], 1.0, rtol=1e-12)
    mean = {mode: rows for (_, mode), rows in split(result.tables.modes, "tracker", "mode").items()}
    np.testing.assert_allclose((mean["cv"]["probability"] + mean["ctrv"]["probability"])[known], 1.0, rtol=1e-12)
    assert np.nanmean(mean["cv"]["probability"]) > 0.5


def test_the_mean_is_that_of_single_runs(tmp_path, result):
    singles = []
    for run in range(3):
        path = tmp_path / "bend.yaml"
        path.write_text(SCENARIO)
        changes = {
            "truth.objects.car.pieces": [{"for_s": 2}],
            "truth.duration_s": 2,
            "trackers.imm.initial": "two_measurements",
            "score.settle_s": 0.2,
            "recording.run": run,
        }
        one = tb.run(tb.load(path, changes, runs=3))
        singles.append(one.tables.recorded_modes.to_pandas()["probability"])
    mean = result.tables.modes.to_pandas()["probability"]
    np.testing.assert_allclose(np.mean(singles, axis=0), mean, rtol=1e-12)


@pytest.mark.parametrize("batched", [True, False])
def test_what_is_no_probability_is_refused(tmp_path, batched):
    failed = of(tmp_path, MINE.format(batched=batched, probabilities="[np.ones(7)]"))["mine"].failed
    assert failed is not None
    assert "mode probabilities" in failed.cause
