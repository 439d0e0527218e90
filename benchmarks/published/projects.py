"""The published projects of docs/projects: a UKF and an EKF of the Udacity course, and a radar-only EKF at 3 km."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from .rows import Row, Source

sys.path.append(str(Path(__file__).parents[2] / "docs" / "projects"))

#: The misprint as it was printed, by its row's name.
MISPRINT = {"std_a 0.1, std_yawdd 0.1": (0.1305, 0.1341, 0.5454, 0.3111)}


def ukf_copy() -> Source:
    """Return the tables of the UKF beside those of a copy with the published program's faults."""
    import udacity

    published = (*udacity.UKF, *udacity.TUNED)
    result = udacity.result(udacity.TUNING, [row.copy for row in published])
    rows = []
    for row in published:
        ours = udacity.rmse(result, row.copy, udacity.UKF_SCORED)
        rows.append(Row(row.what, MISPRINT.get(row.what, row.published), ours, 4, why=MISPRINTED))
    return Source("The UKF of the Udacity course, a copy", COPY_TEXT, tuple(rows), ("printed", "copy", "95 %"))


def ukf_own() -> Source:
    """Return the first table of the UKF beside that of the bench's own filter, which has no faults."""
    import udacity

    result = udacity.result(udacity.TUNING, [row.sound for row in udacity.UKF])
    rows = []
    for row in udacity.UKF:
        ours = udacity.rmse(result, row.sound, udacity.UKF_SCORED)
        rows.append(Row(row.what, row.published, ours, 4, why=FAULTS))
    return Source("The UKF of the Udacity course, our own", OWN_TEXT, tuple(rows), ("printed", "sound filter", "95 %"))


def udacity_ekf() -> Source:
    """Return the two rows of the EKF."""
    import udacity

    result = udacity.result(udacity.FUSION, [row.copy for row in udacity.EKF])
    rows = (Row(row.what, row.published, udacity.rmse(result, row.copy), 4, why=START) for row in udacity.EKF)
    return Source("The EKF of the Udacity course", EKF_TEXT, tuple(rows))


def range_3km() -> Source:
    """Return the RMSE of the radar-only EKF, of which one run was published for each case."""
    import range_3km as project

    rows = []
    for case in project.PUBLISHED:
        places = project.places(case, project.result(case, tracker="ekf"), "ekf")
        for axis, place in zip(project.AXES, places, strict=True):
            low, high = place.range95
            rows.append(
                Row(f"({case}) {axis}", (place.published,), (float(np.median(place.values)),), 2, (low, high), NOISE)
            )
    return Source("A radar-only EKF at 3 km", RANGE_TEXT, tuple(rows), ("printed", "median", "middle 95 % of runs"))


COPY_TEXT = """\
[The project](https://github.com/ArjaanBuijk/CarND-Unscented-Kalman-Filter-Project) prints the RMSE of px, py (m),
vx, vy (m/s) over the first 498 of 500 estimates of one recording, as this table does. The report of
`recorded/udacity_ukf_tuning` is over all 500 (`published`: 0.0671 0.0804 0.3747 0.2166). The copy has the
program's faults ([page](../../docs/projects/udacity-ukf.md)): agreement proves the copy, not our filter."""
OWN_TEXT = """\
By `ukf...`, our filter without the faults."""
MISPRINTED = """\
The printed vx is 0.5454. The copy has every other digit of the eleven rows, and 0.4554 here: probably
two digits exchanged."""
FAULTS = """\
The program averages azimuths as plain numbers, also across the direction where they jump by 2 pi, and its Cholesky
factor stops unnoticed at a pivot that is not positive. Without these faults the radar alone is worse by 17 % in py:
they were lucky."""
EKF_TEXT = """\
The same over 500 measurements. Ours: `ekf` and `ekf_half_known` of `recorded/udacity_fusion`
([page](../../docs/projects/udacity-fusion.md))."""
START = """\
How the source starts from two lidar measurements is not known. Taken literally it is farther off than the start
shown: from one measurement, the velocity half known."""
RANGE_TEXT = """\
One run of each case was published, RMSE in m. Ours: 1,000 runs
([page](../../docs/projects/range-3km.md))."""
NOISE = """\
The error along the motion is smaller than in nearly every run: the stated Q adds 20 m² to each position at every
step, which keeps it larger. With less of it and a known first velocity all eight are inside, which does not show
that the program did this. Its radar measures the target's speed over ground, which no real radar does."""
