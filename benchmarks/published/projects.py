"""The published projects of docs/projects: a UKF and an EKF of the Udacity course, and a radar-only EKF at 3 km."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from .rows import Row, Source

sys.path.append(str(Path(__file__).parents[2] / "docs" / "projects"))

#: The misprint as it was printed, by its row's name.
MISPRINT = {"std_a 0.1, std_yawdd 0.1": (0.1305, 0.1341, 0.5454, 0.3111)}


def udacity_ukf() -> Source:
    """Return the tables of the UKF, by the copy with the published program's faults and by a sound filter."""
    import udacity

    result = udacity.result(udacity.TUNING)
    rows = []
    for row in (*udacity.UKF, *udacity.TUNED):
        copy, sound = (udacity.rmse(result, name, udacity.UKF_SCORED) for name in (row.copy, row.sound))
        printed = MISPRINT.get(row.what, row.published)
        rows.append(Row(row.what, printed, copy, 4, why=MISPRINTED))
        if row.sound != "ukf_lidar" and row in udacity.UKF:
            rows.append(Row(f"{row.what}, sound filter", printed, sound, 4, why=FAULTS))
    return Source("The UKF of the Udacity course", UKF_TEXT, tuple(rows))


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
    return Source("A radar-only EKF at 3 km", RANGE_TEXT, tuple(rows))


UKF_TEXT = """\
[The project](https://github.com/ArjaanBuijk/CarND-Unscented-Kalman-Filter-Project) prints the RMSE of px, py (m),
vx, vy (m/s) over 498 measurements of one recording. Ours: `published...` of `recorded/udacity_ukf_tuning`, a copy
with the program's faults, and a sound filter ([page](../../docs/projects/udacity-ukf.md))."""
MISPRINTED = """\
The printed vx is 0.5454. The copy has every other digit of the eleven rows, and 0.4554 here: two digits exchanged."""
FAULTS = """\
The program averages azimuths as plain numbers, also across the direction where they jump by 2 pi, and its Cholesky
factor stops unnoticed at a pivot that is not positive. Without these faults the radar alone is worse by 17 % in py:
they were lucky."""
EKF_TEXT = """\
The same over 500 measurements. Ours: `ekf` and `ekf_half_known` of `recorded/udacity_fusion`
([page](../../docs/projects/udacity-fusion.md))."""
START = """\
How the source starts from two lidar measurements is not known. Taken literally it is farther off than the start that
is shown: from one measurement, the velocity half known."""
RANGE_TEXT = """\
One run of each case was published, RMSE in m. Ours: the median and the middle 95 % of 1,000 runs
([page](../../docs/projects/range-3km.md))."""
NOISE = """\
The error along the motion is smaller than in nearly every run: the stated Q adds 20 m² to each position at every
step, which keeps it larger. With less of it and a known first velocity all eight are inside, which does not show
that the program did this. Its radar is taken to read the speed of the target, as none does."""
