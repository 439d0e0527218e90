"""PMB and JIPDA agree, run by run, with the PMB filter of its authors on the detections of Williams' scenario 1."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pandas as pd
import pytest
from benchmarks.williams_one import METHODS, RUNS, folder, rows, scenario, squared_gospa

import trackbench as tb

CUTOFF_M = 10.0
METHODS_COMPARED = ("pmb", "jipda")

pytestmark = pytest.mark.skipif(
    not (folder() / "reference.csv").is_file(), reason="the published detections are not there: set TRACKBENCH_DATA"
)


def gospa_squared(objects: np.ndarray, tracks: np.ndarray) -> float:
    """The best of all assignments of positions ``(n, 2)``, m^2: p = 2, alpha = 2."""
    if len(objects) > len(tracks):
        objects, tracks = tracks, objects
    cost = np.minimum(np.sum((objects[:, None] - tracks[None]) ** 2, axis=-1), CUTOFF_M**2)
    best = min(
        (sum(cost[i, j] for i, j in enumerate(order)) for order in permutations(range(len(tracks)), len(objects))),
        default=0.0,
    )
    return float(best + CUTOFF_M**2 / 2 * (len(tracks) - len(objects)))


def mean_gospa(estimates: pd.DataFrame, truth: pd.DataFrame) -> float:
    """Of one run, over the times of the truth."""
    positions = ["x_m", "y_m"]
    values = [
        gospa_squared(there[positions].to_numpy(), estimates.loc[estimates["time_s"] == time, positions].to_numpy())
        for time, there in truth.groupby("time_s")
    ]
    return float(np.mean(values))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> tb.Result:
    methods = {name: METHODS[name] for name in METHODS_COMPARED}
    return tb.run(tb.load(scenario(tmp_path_factory.mktemp("williams"), RUNS, methods)))


def test_the_reference_is_the_gospa_of_its_estimates() -> None:
    truth, reference = pd.read_csv(folder() / "truth.csv"), pd.read_csv(folder() / "reference.csv")
    estimates = pd.read_csv(folder() / "estimates.csv.gz")
    for run in (1, 12):
        stated = reference.loc[reference["run"] == run, "gospa_squared_m2"].mean()
        assert mean_gospa(estimates[estimates["run"] == run], truth) == pytest.approx(stated, abs=0.01)


@pytest.mark.slow
def test_the_score_is_that_of_all_assignments(result: tb.Result) -> None:
    truth, tracks = pd.read_csv(folder() / "truth.csv"), result.to_pandas("tracks")
    for method in METHODS_COMPARED:
        own = tracks[tracks["tracker"] == method].rename(columns={"px_m": "x_m", "py_m": "y_m"})
        # The truth's first instant is 0 s in a recording.
        own = own.assign(time_s=(own["time_s"] + 1).round())
        assert mean_gospa(own, truth) == pytest.approx(squared_gospa(result, method)[0], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS_COMPARED)
def test_it_agrees_with_the_filter_of_the_authors(result: tb.Result, method: str) -> None:
    found = rows(result, RUNS, [method])[method]
    assert abs(found.paired_t) < 2
    assert found.ratio == pytest.approx(1, abs=0.04)
    for part in ("gospa_missed", "gospa_false"):
        assert found.rms[part] == pytest.approx(found.reference[part], rel=0.1)
