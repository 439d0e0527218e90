"""FilterPy's and Stone Soup's EKF as trackers of one's own: they agree with the built-in filter of the same model."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import DOCS
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, scan, tracker

from trackbench.base.types import Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.testing import check_tracker
from trackbench.trackers.published import create

PAGE = DOCS / "filterpy-stonesoup.md"
EXAMPLES = DOCS / "examples"
#: The first state of the examples.
START = {"velocity": "zero", "unbiased": False, "covariance_diag": [1, 1, 400, 400]}
#: By library: the example, the built-in filter of the same model, and how far their estimates may differ, m and m/s.
#: Stone Soup takes the derivative by finite differences.
PEERS: dict[str, tuple[str, dict[str, Any], float]] = {
    "filterpy": (
        "filterpy_tracker:FilterPyEkf",
        {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "initial": START},
        1e-9,
    ),
    "stonesoup": (
        "stonesoup_tracker:StoneSoupEkf",
        {
            "filter": "ekf",
            "motion": "cv_continuous",
            "acceleration_density_mps1p5": sqrt(0.5),
            "initial": START,
        },
        1e-5,
    ),
}
each_library = pytest.mark.parametrize("library", PEERS)


@pytest.fixture(autouse=True)
def _installed(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The libraries, and the examples as the modules of the working directory."""
    needed = [request.getfixturevalue("library")] if "library" in request.fixturenames else []
    for library in PEERS if request.node.get_closest_marker("docs_pages") else needed:
        pytest.importorskip(library, reason=f"needs {library}, a dependency of the tests alone")
    monkeypatch.syspath_prepend(EXAMPLES)


def measurements(steps: int = 150) -> Iterator[Scan]:
    """Radar and lidar of a target that weaves around a moving, turning sensor; some missed, some at one instant."""
    random = np.random.default_rng(8)
    x, y, time = 12.0, 6.0, 0.0
    for k in range(steps):
        dt = 0.0 if k % 7 == 5 else 0.04 + 0.02 * (k % 3)
        course = 2.4 + 0.6 * time + 0.3 * sin(time)
        vx, vy = 8 * cos(course), 8 * sin(course)
        x, y, time = x + dt * vx, y + dt * vy, time + dt
        kind, noise = ("lidar", LIDAR_NOISE) if k % 2 else ("radar", RADAR_NOISE)
        pose, velocity = (-0.5 * time, 0.8 * time, 0.7 + 0.1 * time), (-0.5, 0.8)
        exact = SENSOR_MODELS[kind].measure(np.array([x, y, vx, vy]), np.array(pose), np.array(velocity))
        error = random.multivariate_normal(np.zeros(len(noise)), noise)
        yield scan(kind, time, exact + error, k % 11 != 9, pose=pose, velocity=velocity)


@each_library
def test_each_estimate_is_that_of_the_built_in_filter(library: str) -> None:
    use, keys, tolerance = PEERS[library]
    example, built_in = create(use, {})(), tracker(**keys)
    scans = list(measurements())
    azimuths = [seen.measurement[1] for seen in scans if seen.kind == "radar" and seen.valid]
    assert np.abs(np.diff(azimuths)).max() > np.pi, "the azimuth passes pi"
    state, own_state = None, None
    for seen in scans:
        state, (mean, covariance) = example.step(state, seen)
        own_state, estimate = built_in.step(own_state, seen)
        np.testing.assert_allclose(mean, estimate.mean, rtol=0, atol=tolerance)
        np.testing.assert_allclose(covariance, estimate.covariance, rtol=10 * tolerance, atol=tolerance)


@each_library
def test_the_contract_of_a_tracker_is_kept(library: str) -> None:
    check_tracker(PEERS[library][0])


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    for library in PEERS:
        shutil.copy(EXAMPLES / f"{library}_tracker.py", tmp_path)
    assert run_page(PAGE, tmp_path) == 1
    assert (tmp_path / "results" / "highway" / "report.html").exists()
