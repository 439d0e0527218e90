"""Scenarios by both engines: the same metrics, orders, verdicts and expectations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.support.udacity import data_folder

from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.shipped import shipped
from trackbench.scenario.truth import truths_of

pytestmark = pytest.mark.usefixtures("kernels")
#: Those that are tried at every change, so short.
SHORT = ("scripted/own_model_ctrv", "latency/late_radar", "traffic/side_by_side")
FEW = "monte_carlo.runs=3"
#: Relative, or of a metre, a second and their like.
LIMIT, LEAST = 1e-9, 1e-3
#: What says how long something took, or what computed it.
OTHER = ("step_time", "engine", "why_numpy", "command")


def same(name: str, *settings: str) -> None:
    loaded = load_scenario(name, settings)
    truths = truths_of(loaded)
    results = [run_scenario(loaded, truths, engine=engine) for engine in ("numpy", "fused")]
    by_numpy, fused = (result.summary for result in results)
    assert by_numpy.engine == "numpy"
    assert fused.engine != "numpy"
    assert [tracker.name for tracker in fused.trackers if tracker.failed] == []
    found = list(differences(fused.model_dump(), by_numpy.model_dump()))
    assert [difference for difference in found if not _is_rounding(difference, results[0])] == []


def _is_rounding(difference: tuple[str, Any, Any], result: Result) -> bool:
    """Whether it is of the NEES of a covariance so near to singular that its inverse has no more digits."""
    at, one, other = difference
    if ".nees." not in at or not (isinstance(one, float) and isinstance(other, float)):
        return False
    name = result.summary.trackers[int(at.split(".")[2])].name
    estimates = result.tables["estimates"].to_pandas()
    table = estimates[estimates["tracker"] == name]
    rows, columns = np.triu_indices(4)
    covariances = np.empty((len(table), 4, 4))
    covariances[:, rows, columns] = table[[f"p_{i}{j}" for i, j in zip(rows, columns, strict=True)]]
    covariances[:, columns, rows] = covariances[:, rows, columns]
    sigmas = np.sqrt(np.einsum("nii->ni", covariances))
    conditions = np.linalg.cond(covariances / sigmas[:, :, None] / sigmas[:, None, :])
    return math.isclose(one, other, rel_tol=float(np.finfo(float).eps * conditions.max()))


def differences(one: Any, other: Any, at: str = "", least: float = LEAST) -> Iterator[tuple[str, Any, Any]]:
    """Where two summaries differ, and what they say there; the ends of an interval relative to the larger."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        for key in one.keys() - OTHER:
            yield from differences(one[key], other[key], f"{at}.{key}")
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        largest = max((abs(end) for end in other if isinstance(end, float) and math.isfinite(end)), default=0.0)
        for i, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{at}.{i}", max(LEAST, largest))
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=LIMIT, abs_tol=LIMIT * least) and not (one != one and other != other):
            yield at, one, other
    elif one != other:
        yield at, one, other


@pytest.mark.parametrize("name", SHORT)
def test_short(name: str) -> None:
    same(name, FEW, "truth.duration_s=4")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(shipped()))
def test_every_shipped_scenario(name: str) -> None:
    if not name.startswith("recorded/"):
        same(name, FEW)
        return
    if name.startswith("recorded/i80"):
        same(name, FEW)
        return
    us101 = dict.fromkeys(("recorded/us101", "recorded/us101_hidden"), "recorded_traffic")
    folders = {"recorded/comma2k19": "comma2k19", **us101}
    recording = data_folder() / folders.get(name, "udacity")
    if not recording.is_dir():
        pytest.skip(f"{recording.name} is not here")
    same(name)
