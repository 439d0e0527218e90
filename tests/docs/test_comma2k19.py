"""The page on a real radar: what its script measures, on scans with known answers and on the recording."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from tests.support.places import DOCS
from tests.support.udacity import data_folder

from trackbench.base.types import Scan

SIGMAS = np.array([0.3, np.deg2rad(0.5), 0.2])


@pytest.fixture
def project() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS / "projects"))
        import comma2k19

        yield comma2k19


def passing(along_road: bool, seed: int, project: ModuleType) -> object:
    """One car in the next lane that a car at rest sees pass, 20 scans a second, without noise in the speed."""
    random = np.random.default_rng(seed)
    model = project.AlongRoad if along_road else project.Radar
    scans = []
    for k in range(200):
        t = 0.05 * k
        target = np.array([[5 + 4 * t], [3.5 + seed], [4.0], [0.0]])
        ideal = model.measure(target, np.zeros(3), np.zeros(2))
        scans.append(
            Scan(
                time=t,
                sensor="radar",
                kind="radar",
                measurement=ideal + 0.02 * random.standard_normal((3, 1)) * SIGMAS[:, None],
                valid=np.ones(1, dtype=bool),
                noise_covariance=np.diag(SIGMAS**2),
                sensor_pose=np.zeros(3),
                sensor_velocity=np.zeros(2),
                arrival_time=t,
            )
        )
    return project.TrackLog(np.arange(200), scans)


@pytest.mark.parametrize("along_road", [False, True])
def test_the_share_of_the_line_of_sight_is_found(project: ModuleType, along_road: bool) -> None:
    share, error = project.share_along_sight(
        project.rate_slopes([passing(along_road, seed, project) for seed in range(4)])
    )
    assert share == pytest.approx(0.0 if along_road else 1.0, abs=0.02)
    assert error < 0.02


def test_the_derivative_of_the_speed_along_the_road(project: ModuleType) -> None:
    state, pose, velocity = np.array([30.0, 4.0, 8.0, -1.0]), np.array([1.0, 2.0, 0.3]), np.array([5.0, 1.0])
    steps = 1e-6 * np.eye(4)
    columns = [
        (project.AlongRoad.measure(state + h, pose, velocity) - project.AlongRoad.measure(state - h, pose, velocity))
        / 2e-6
        for h in steps
    ]
    np.testing.assert_allclose(project.AlongRoad.jacobian(state, pose, velocity), np.array(columns).T, atol=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(
    not (data_folder() / "comma2k19" / "radar.csv").is_file(),
    reason="no recording: set TRACKBENCH_DATA to the folder that holds comma2k19/",
)
def test_the_real_radar_says_the_speed_along_the_line_of_sight(project: ModuleType) -> None:
    _, found = project.sensed(project.REAL)
    logs = project.track_logs(found)
    share, error = project.share_along_sight(project.rate_slopes(logs))
    assert abs(share - 1) < 2 * error
    assert share > 5 * error
    # The vendor's list is filtered, which the page says: an innovation is nearly that of the scan before.
    assert np.all(project.autocorrelation(project.innovations(logs)) > 0.7)
