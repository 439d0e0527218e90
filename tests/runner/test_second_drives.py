"""A plug-in whose estimates depend on the other members of its batch fails by name; an honest one never does."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.conftest import EXAMPLES
from tests.runner.test_traffic_runs import SCENARIO as LANES

from trackbench.results import Result, TrackerResult
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

Run = Callable[..., Result]
Write = Callable[[Path, str], str]

PLUG_INS = """
import numpy as np
from alpha_beta import AlphaBeta
from alpha_beta_batched import BatchedAlphaBeta
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker

class Changed(BatchedAlphaBeta):
    def step(self, state, scan):
        state, (mean, P) = super().step(state, scan)
        return state, self.change(scan, mean, P)

class Averages(Changed):
    "Members are numbered by object, then run."
    def change(self, scan, mean, P):
        runs = np.nanmean(mean.reshape(4, 2, -1), axis=2, keepdims=True)
        return np.broadcast_to(runs, (4, 2, scan.valid.size // 2)).reshape(4, -1), P

class Late(Averages):
    def change(self, scan, mean, P):
        return super().change(scan, mean, P) if scan.time > 1.85 else (mean, P)

class Wide(Averages):
    "Where nobody tries it by hand."
    def change(self, scan, mean, P):
        return super().change(scan, mean, P) if scan.valid.size > 64 else (mean, P)

LATEST = []

class Remembers(Changed):
    "Keeps in the module what it was given, whichever instance it is."
    def change(self, scan, mean, P):
        LATEST.append(np.nanmean(mean[2:]))
        return mean + 1e-3 * np.mean(LATEST), P

class Next(Changed):
    "Looks at the member that comes after each."
    def change(self, scan, mean, P):
        return mean + 1e-3 * (np.append(mean[:, 1:], mean[:, -1:], axis=1) - mean), P

class Normalises(Changed):
    def change(self, scan, mean, P):
        return mean, P * np.trace(P) / np.trace(P).max()

class Draws(Changed):
    def __init__(self, **options):
        super().__init__(**options)
        self.random = np.random.default_rng(1)
    def change(self, scan, mean, P):
        return mean + 0.01 * self.random.standard_normal(mean.shape), P

class SaysSo(Draws):
    random = True

class Shares(AlphaBeta):
    "Unbatched, with a mean over all instances."
    latest = []
    def step(self, state, scan):
        state, (mean, P) = super().step(state, scan)
        Shares.latest = [*Shares.latest[-3:], mean]
        return state, (mean if scan.time < 1 else np.mean(Shares.latest, axis=0), P)

class Drawing(AlphaBeta):
    def step(self, state, scan):
        state, (mean, P) = super().step(state, scan)
        return state, (mean + 0.01 * np.random.standard_normal(4), P)

class SaysDrawing(Drawing):
    random = True

def built_in(**config) -> FilterTracker:
    return build(FilterConfig(**config)).tracker
"""
#: Each with what the failure says of it.
BATCH = "^asked again with half of the batch, permuted, "
DEPENDENT = {
    "Averages": BATCH + r"it gives another estimate: the mean differs by up to [\d.]+ m or m/s, .* over the last axis",
    "Late": BATCH + "it gives another estimate: the mean differs",
    "Remembers": BATCH + "it gives another estimate: the mean differs",
    "Next": BATCH + "it gives another estimate: the mean differs",
    "Normalises": BATCH + "it gives another estimate: the covariance differs",
    "Draws": BATCH + "it gives another estimate: .*; a tracker that draws random numbers must set random = True$",
    "Shares": r"^asked again in a fresh process, with two runs in another order, .* values? that instances share",
    "Drawing": "^asked again in a fresh process, .* must set random = True$",
}
HONEST = ("BatchedAlphaBeta", "AlphaBeta", "SaysSo", "SaysDrawing")
FILTERS = {
    "kf": "{filter: kf, motion: cv, acceleration_sigma_mps2: 3}",
    "ukf": "{filter: ukf, motion: ctra, yaw_acceleration_sigma_radps2: 1, jerk_sigma_mps3: 1}",
    "ckf": "{filter: ckf, motion: ca, jerk_sigma_mps3: 1}",
}


@pytest.fixture(scope="module")
def plug_ins(tmp_path_factory: pytest.TempPathFactory, write_module: Write) -> tuple[Path, str]:
    """The folder and the module that has them all."""
    folder = tmp_path_factory.mktemp("plug_ins")
    for name in ("alpha_beta", "alpha_beta_batched"):
        shutil.copy(EXAMPLES / f"{name}.py", folder)
    return folder, write_module(folder, PLUG_INS)


@pytest.fixture(scope="module")
def outcome(plug_ins: tuple[Path, str], run_tiny: Run) -> Result:
    """All of them in one run."""
    folder, module = plug_ins
    filters = (f"trackers.{name}={{use: '{module}:built_in', options: {options}}}" for name, options in FILTERS.items())
    names = (*DEPENDENT, *HONEST)
    return run_tiny(*(f"trackers.{name}.use={module}:{name}" for name in names), *filters, folder=folder)


def entry(result: Result, name: str) -> TrackerResult:
    return next(tracker for tracker in result.summary.trackers if tracker.name == name)


@pytest.mark.parametrize("name", DEPENDENT)
def test_who_depends_on_the_others_fails_by_name(outcome: Result, name: str) -> None:
    failed = entry(outcome, name).failed
    assert failed is not None
    assert re.search(DEPENDENT[name], failed.cause), failed.cause
    assert failed.run in range(4)
    assert failed.object in outcome.summary.truth.objects
    assert failed.sensor in ("radar", "lidar")
    assert name != "Late" or failed.time_s == pytest.approx(1.9)


@pytest.mark.parametrize("name", [*HONEST, *FILTERS])
def test_who_does_not_passes(outcome: Result, name: str) -> None:
    assert entry(outcome, name).failed is None
    assert entry(outcome, name).random == (name in ("SaysSo", "SaysDrawing"))


def test_who_looks_at_the_others_in_wide_batches_alone_fails_there(plug_ins: tuple[Path, str], run_tiny: Run) -> None:
    folder, module = plug_ins
    for runs, fails in ((32, False), (40, True)):
        result = run_tiny(f"trackers={{wide: {{use: '{module}:Wide'}}}}", f"monte_carlo.runs={runs}", folder=folder)
        assert (entry(result, "wide").failed is not None) == fails


def test_late_and_unread_sensors_make_no_difference(plug_ins: tuple[Path, str], run_tiny: Run) -> None:
    folder, module = plug_ins
    late = ["sensors.lidar.latency_s=[0.05, 0.3]", "sensors.radar.detection_probability=0.8"]
    filters = [f"trackers.{name}={{use: '{module}:built_in', options: {FILTERS[name]}}}" for name in ("kf", "ukf")]
    names = ("BatchedAlphaBeta", "AlphaBeta")
    radar = [f"trackers.{name}_radar={{use: '{module}:{name}', sensors: [radar]}}" for name in names]
    both = [f"trackers.{name}.use={module}:{name}" for name in names]
    result = run_tiny(*late, *filters, *radar, *both, folder=folder)
    assert [tracker.failed for tracker in result.summary.trackers] == [None] * 8


SEVERAL = """
import numpy as np
from trackbench.base.types import Tracks
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

class Several:
    batched = True
    def __init__(self):
        initial = {"from": "first_measurement"}
        motion = {"motion": "cv", "acceleration_sigma_mps2": 1}
        config = FilterConfig(filter="ekf", **motion, initial=initial, associate={"method": "gnn"})
        self.inner = build_multi(config).tracker
    def step(self, state, scan):
        state, tracks = self.inner.step(state, scan)
        return state, self.change(scan, tracks)
    def change(self, scan, tracks):
        return tracks

class SharedIds(Several):
    "One counter for the ids of all runs, which is nobody's fault."
    def __init__(self):
        super().__init__()
        self.names = {}
    def change(self, scan, tracks):
        ids = tracks.ids.copy()
        for column, run in np.argwhere(ids >= 0):
            ids[column, run] = self.names.setdefault((run, ids[column, run]), len(self.names))
        return tracks._replace(ids=ids)

class Averages(Several):
    "The estimates of the first track of each run are those of all runs."
    def change(self, scan, tracks):
        if not len(tracks.ids) or (tracks.ids[0] < 0).any():
            return tracks
        mean = tracks.mean.copy()
        mean[:, 0] = mean[:, 0].mean(axis=-1, keepdims=True)
        return tracks._replace(mean=mean)

class Removes(Several):
    "Drops all tracks where the runs have an odd number of detections together."
    def change(self, scan, tracks):
        return tracks._replace(ids=np.where(np.count_nonzero(scan.valid) % 2, -1, tracks.ids))

class Renames(Several):
    def change(self, scan, tracks):
        odd = np.count_nonzero(scan.valid) % 2
        return tracks._replace(ids=np.where(tracks.ids >= 0, 2 * tracks.ids + odd, -1))

class Alone(Several):
    batched = False
    def step(self, state, scan):
        scan = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
        state, tracks = super().step(state, scan)
        return state, Tracks(*(None if part is None else part[..., 0] for part in tracks))

class Shares(Alone):
    seen = []
    def change(self, scan, tracks):
        Shares.seen.append(scan.valid.size)
        return tracks._replace(covariance=tracks.covariance * (1 + 1e-3 * np.mean(Shares.seen[-3:])))
"""


@pytest.mark.parametrize("late", [False, True])
def test_trackers_of_several_objects(tmp_path: Path, write_module: Write, late: bool) -> None:
    (tmp_path / "lanes.yaml").write_text(LANES, encoding="utf-8")
    module = write_module(tmp_path, SEVERAL)
    problems = {
        "Several": None,
        "SharedIds": None,
        "Alone": None,
        "Averages": "the mean differs",
        "Removes": "one has a ",
        "Renames": "a track goes on under another id",
        "Shares": "asked again in a fresh process, with two runs in another order, it gives another estimate: the cov",
    }
    trackers = "{" + ", ".join(f"{name}: {{use: '{module}:{name}'}}" for name in problems) + "}"
    sensor = ["sensors.lidar.latency_s=0.15"] if late else []
    loaded = load_scenario(tmp_path / "lanes.yaml", [f"trackers={trackers}", *sensor, "monte_carlo.runs=5"])
    result = run_scenario(loaded, truths_of(loaded))
    for name, problem in problems.items():
        failed = entry(result, name).failed
        assert (failed is None) == (problem is None), f"{name}: {failed}"
        if failed is not None and problem is not None:
            assert problem in failed.cause
            assert failed.run in range(5)
