"""The probability of a correct association of Mori, Chang, Chong and Dunn, beside the bench's assignment."""

from __future__ import annotations

import math

import numpy as np

from trackbench.trackers.multi.association import assigned

from .rows import Row, Source, of_runs

RUNS, TARGETS = 100, 1000
#: Targets per m^3, and the determinant of the innovation covariance, m^6, of the printed example.
DENSITY, DETERMINANT = 1e-6, 1e9
PRINTED = 74.16


def formula(crowding: float) -> float:
    """Return the probability in space by equations 2 and 3 of Mori et al. (1995), per cent.

    Args:
        crowding: density of the targets times the root of det S.
    """
    constant = 4 * np.pi / math.gamma(2.5)
    return 100 * math.exp(-constant * crowding)


def correct_share(random: np.random.Generator, crowding: float) -> float:
    """Return the percentage of targets that the best assignment gives their own measurement.

    Targets are Poisson in a periodic cube, with an innovation of unit covariance each; none is missed or false.
    """
    side = (TARGETS / crowding) ** (1 / 3)
    count = random.poisson(TARGETS)
    predicted = random.uniform(0, side, (count, 3))
    measured = predicted + random.standard_normal((count, 3))
    difference = measured - predicted[:, None]
    difference -= side * np.round(difference / side)
    distance = np.sum(difference**2, axis=-1)
    track, detection = np.nonzero(distance < 100)
    taken = assigned(track, detection, 50 - distance[track, detection] / 2)
    return float(100 * np.sum(track[taken] == detection[taken]) / count)


def association(runs: int = RUNS) -> Source:
    """Return the printed example by the formula, and what the best assignment does."""
    random = np.random.default_rng(7)
    crowding = DENSITY * math.sqrt(DETERMINANT)
    shares = np.array([correct_share(random, crowding) for _ in range(runs)])
    rows = (
        Row("equation 2, %", (PRINTED,), (formula(crowding),), 2),
        of_runs("best assignment, %", PRINTED, shares, 2, CYCLES),
    )
    return Source("Mori, Chang, Chong and Dunn's correct association", TEXT, rows)


TEXT = """\
Mori, Chang, Chong and Dunn (1995), IEEE T-AC 40(5), equation 2. Printed: the example of `correctAssocProbApprox` in
the Naval Research Laboratory's `TrackerComponentLibrary`, with 10³ targets per km³ and det S = 10⁹ m⁶. Ours:
1,000 targets are drawn in space, 100 times, and the assignment of `gnn` pairs them with their measurements."""
CYCLES = """\
Equation 2 counts exchanges of two targets: simulated, 75.0 % of the targets have no such exchange that lowers the cost
(exp(-n), with n its mean number for a target: 74.1 %). Exchanges around three and more targets take the rest. At a
tenth of the density all agree."""
