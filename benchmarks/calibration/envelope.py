"""Borders of maps whose true border is known in closed form"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

import trackbench as tb
from trackbench.base.execution import executor
from trackbench.subjects.envelope.axes import Point
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import task_of

from .claim import STATED, Claim, power, rate

#: The standard deviation of a filter's process noise over the acceleration that it follows (Blair 2008, table I).
K1 = 1.677
REPEATS = 200


class Border(NamedTuple):
    """Between the last value that holds and the first that fails along an axis; infinite where there is none."""

    low: float
    high: float

    def holds(self, truth: float) -> bool:
        return self.low <= truth <= self.high

    @property
    def decades(self) -> float:
        """How wide it is."""
        return math.log10(self.high / self.low) if self.low > 0 and self.high < math.inf else math.inf


def made(scenario: dict[str, Any], seed: int) -> EnvelopeMap:
    """The map of a scenario with a seed of its own."""
    with executor(1) as chosen:
        envelope = EnvelopeMap(task_of(tb.load(scenario, seed=seed)), chosen)
        envelope.make()
    return envelope


def border(envelope: EnvelopeMap, tracker: str) -> Border:
    """That of a map of one axis on which the tracker holds at small values."""
    states = {float(point[0]): cell.states[tracker] for point, cell in envelope.cells.items()}
    held = [value for value, state in states.items() if state == "holds"]
    failed = [value for value, state in states.items() if state == "fails"]
    return Border(max(held, default=0.0), min(failed, default=math.inf))


def runs_of(envelope: EnvelopeMap) -> int:
    """How many runs were made in all cells."""
    return sum(tracker.extent.parts for cell in envelope.cells.values() for tracker in cell.trackers.values())


# Blair: a filter of constant velocity follows a constant acceleration.


def steady_error(acceleration: float) -> float:
    """Root mean square error of the filtered position over that of the measurement, for T = 1 s and sigma_w = 1 m.

    Kalata (1984) gives alpha and beta of the tracking index; Blair (2008, 2012) the worst mean square error.
    """
    index = K1 * acceleration
    r = (4 + index - math.sqrt(8 * index + index**2)) / 4
    alpha = 1 - r * r
    beta = 2 * (2 - alpha) - 4 * math.sqrt(1 - alpha)
    noise = (2 * alpha**2 + beta * (2 - 3 * alpha)) / (alpha * (4 - 2 * alpha - beta))
    return math.sqrt(noise + ((1 - alpha) / beta * acceleration) ** 2)


def blair(levels: int, cells: int, most: int) -> dict[str, Any]:
    """Along the manoeuvre index, from 0.1 to 10: the limit is a root mean square error of the measurement's sigma."""
    return {
        "name": "blair",
        "truth": {
            "source": "scripted",
            "duration_s": 140,
            "rate_hz": 1,
            "objects": {"car": {"start": {"x": 0, "speed_mps": 0}, "pieces": [{"acceleration_mps2": 1}]}},
        },
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 1, "position_sigma_m": 1}},
        "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1}},
        "score": {"settle_s": 40, "divergence_m": 1000},
        "expect": [{"tracker": "kf", "metric": "rmse.px", "below": LIMIT}],
        "envelope": {
            "cells": cells,
            "runs": {"first": 25 if most > 25 else most, "most": most},
            "resolution": 0.002,
            "axes": {
                "index": {
                    "keys": {
                        "truth.objects.car.pieces.0.acceleration_mps2": {},
                        "trackers.kf.acceleration_sigma_mps2": {"factor": K1},
                    },
                    "from": 0.1,
                    "to": 10,
                    "scale": "log",
                    "levels": levels,
                }
            },
        },
    }


#: Over the standard deviation of the measurement.
LIMIT = 0.9


def true_index() -> float:
    """The index at which the error is the limit: it grows with it."""
    low, high = 0.1, 10.0
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if steady_error(middle) < LIMIT else (low, middle)
    return low


def _blair() -> Iterator[Claim]:
    truth, inside, wider = true_index(), [], []
    for seed in range(REPEATS):
        adaptive = made(blair(9, 25, 400), seed)
        found = border(adaptive, "kf")
        inside.append(found.holds(truth))
        if seed % 100 < 25:
            # As many cells, spread evenly, with equal shares of the same runs.
            fixed = border(made(blair(25, 25, max(25, runs_of(adaptive) // 25)), seed), "kf")
            wider.append(found.decades / fixed.decades)
    what = f"border of a constant-velocity filter over the manoeuvre index (Blair), limit {LIMIT} sigma"
    yield rate(what, inside, 0.92, 1)
    ratio = float(np.mean(wider))
    what = "width of its band over that of a fixed design with the same runs"
    yield Claim(what, f"{ratio:.2f}, at most {max(wider):.2f}", "at most 1.5", ratio <= 1.5)


# Riccati: a Kalman filter that knows process and measurement noise.


def steady_sigma(process: float, measurement: float, dt: float = 0.5) -> float:
    """Standard deviation of the filtered position in the steady state, by iteration of the Riccati equation."""
    f, g = np.array([[1, dt], [0, 1]]), np.array([dt * dt / 2, dt])
    p = np.eye(2) * 100.0
    for _ in range(3000):
        p = f @ p @ f.T + process**2 * np.outer(g, g)
        gain = p[:, 0] / (p[0, 0] + measurement**2)
        p = p - np.outer(gain, p[0])
    return float(math.sqrt(p[0, 0]))


def riccati() -> dict[str, Any]:
    """Over both noises; the error may be 0.5 m along an axis."""
    white = {"white_acceleration": {"x_sigma_mps2": 1, "y_sigma_mps2": 1}}
    return {
        "name": "riccati",
        "truth": {
            "source": "scripted",
            "duration_s": 40,
            "rate_hz": 2,
            "objects": {"car": {"start": {"x": 0, "speed_mps": 5}, "pieces": [white]}},
        },
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 2, "position_sigma_m": 1}},
        "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1}},
        "score": {"settle_s": 20, "divergence_m": 1000},
        "expect": [{"tracker": "kf", "metric": "position_rmse", "below": 0.5 * math.sqrt(2)}],
        "envelope": {
            "cells": 80,
            "runs": {"first": 25, "most": 200},
            "axes": {
                "process": {
                    "keys": {
                        "truth.objects.car.pieces.0.white_acceleration.x_sigma_mps2": {},
                        "truth.objects.car.pieces.0.white_acceleration.y_sigma_mps2": {},
                        "trackers.kf.acceleration_sigma_mps2": {},
                    },
                    "from": 0.1,
                    "to": 10,
                    "scale": "log",
                },
                "measurement": {"key": "sensors.lidar.position_sigma_m", "from": 0.2, "to": 2, "scale": "log"},
            },
        },
    }


def _riccati(repeats: int = 6) -> Iterator[Claim]:
    wrong, near = [], []
    for seed in range(repeats):
        cells = made(riccati(), seed).cells
        states = {point: cell.states["kf"] for point, cell in cells.items()}
        wrong.append(any(_wrong(states, lambda point: steady_sigma(*map(float, point)) < 0.5)))
        far = [p for p in states if abs(steady_sigma(*map(float, p)) / 0.5 - 1) >= 0.1]
        near.append(np.mean([states[point] != "undecided" for point in far]))
    yield rate("maps over process and measurement noise with a wrong cell (Riccati equation)", wrong, 0, 0.05)
    yield power("share of their cells 10 % or more from the limit that are decided", near, 0.95)


def _wrong(states: dict[Point, str], holds: Any) -> Iterator[bool]:
    """Of each decided cell whether it is decided wrongly."""
    for point, state in states.items():
        if state != "undecided":
            yield (state == "holds") != holds(point)


# M of N: an object that stands, without false alarms.

NEEDED, AMONG, SCANS = 3, 5, 6
DETECTION = "sensors.lidar.detection_probability"


def confirmed(detection: float) -> float:
    """Probability that a track is confirmed within all scans: each sequence of detections, tried.

    A tentative track starts with a detection; it is confirmed where NEEDED of its first AMONG scans have one, and
    deleted once that cannot be any more, after which the next detection starts another.
    """
    total = 0.0
    for sequence in product((0, 1), repeat=SCANS):
        weight = math.prod(detection if hit else 1 - detection for hit in sequence)
        total += weight * _confirms(sequence)
    return total


def _confirms(sequence: tuple[int, ...]) -> bool:
    first: int | None = None
    hits = 0
    for scan, hit in enumerate(sequence):
        if first is None:
            first, hits = (scan, 1) if hit else (None, 0)
        else:
            hits += hit
        if first is not None:
            age = scan - first + 1
            if hits >= NEEDED:
                return True
            if hits + AMONG - age < NEEDED:
                first, hits = None, 0
    return False


def m_of_n() -> dict[str, Any]:
    """Over the detection probability; half of the objects may never be tracked."""
    return {
        "name": "confirmation",
        "truth": {
            "source": "scripted",
            "duration_s": (SCANS - 1) / 10,
            "rate_hz": 10,
            "objects": {"car": {"start": {"x": 20, "y": 5}}},
        },
        "sensing": {"identities": "hidden"},
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.1, "detection_probability": 0.5}},
        "trackers": {
            "gnn": {
                "filter": "kf",
                "motion": "cv",
                "acceleration_sigma_mps2": 1,
                "associate": {"method": "gnn", "gate": 0.9999999, "confirm": [NEEDED, AMONG], "delete_after_s": 1},
            }
        },
        "expect": [{"tracker": "gnn", "metric": "never_confirmed", "below": 0.5}],
        "envelope": {
            "cells": 20,
            "runs": {"first": 50, "most": 800},
            "resolution": 0.01,
            "axes": {
                "detection": {"key": "sensors.lidar.detection_probability", "from": 0.05, "to": 0.95, "levels": 7}
            },
        },
    }


def _m_of_n(repeats: int = 6) -> Iterator[Claim]:
    wrong = []
    for seed in range(repeats):
        states = {point: cell.states["gnn"] for point, cell in made(m_of_n(), seed).cells.items()}
        wrong.append(any(_wrong(states, lambda point: confirmed(float(point[0])) > 0.5)))
    yield rate(f"maps of {NEEDED} of {AMONG} confirmation with a wrong cell (binomial)", wrong, 0, 0.05)


# Mori: objects that stand at random, nearest neighbours, no false alarms.

DENSITY, OBJECTS, MORI_SCANS, CORRECT = 0.004, 20, 17, 0.95


def correct(sigma: float) -> float:
    """Mean probability of a correct association (Mori, Chang, Chong and Dunn 1995): exp(-pi density |S|^(1/2)).

    The innovation of a standing object, measured k times before, has the variance sigma^2 (1 + 1/k) along each axis.
    The first second is not scored.
    """
    each = [math.exp(-math.pi * DENSITY * sigma**2 * (1 + 1 / k)) for k in range(2, MORI_SCANS)]
    return float(np.mean(each))


def mori(seed: int) -> dict[str, Any]:
    """Over the standard deviation of a position; the density is that of the objects."""
    side = math.sqrt(OBJECTS / DENSITY)
    places = np.random.default_rng(seed).uniform(0, side, (OBJECTS, 2)).tolist()
    return {
        "name": "mori",
        "truth": {
            "source": "scripted",
            "duration_s": (MORI_SCANS - 1) / 2,
            "rate_hz": 2,
            "objects": {f"o{number}": {"start": {"x": 200 + x, "y": y}} for number, (x, y) in enumerate(places)},
        },
        "sensing": {"identities": "hidden"},
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 2, "position_sigma_m": 1}},
        "trackers": {
            "gnn": {
                "filter": "kf",
                "motion": "cv",
                "acceleration_sigma_mps2": 0.01,
                "initial": {"from": "first_measurement", "velocity_sigma_mps": 0.01},
                "associate": {"method": "gnn", "gate": 0.999999, "confirm": [1, 1], "delete_after_s": 5},
            }
        },
        "score": {"cutoff_m": 50},
        "expect": [{"tracker": "gnn", "metric": "association_right", "above": CORRECT}],
        "envelope": {
            "cells": 12,
            "runs": {"first": 400, "most": 400},
            "axes": {"sigma": {"key": "sensors.lidar.position_sigma_m", "from": 1, "to": 3, "levels": 5}},
        },
    }


def _mori(repeats: int = 1) -> Iterator[Claim]:
    low, high = 1.0, 3.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if correct(middle) > CORRECT else (low, middle)
    borders = [border(made(mori(seed), 1), "gnn") for seed in range(repeats)]
    middles = [(item.low + item.high) / 2 for item in borders]
    gap = 100 * (float(np.mean(middles)) / low - 1)
    shown = f"{min(middles):.2f} to {max(middles):.2f} m over {repeats} sets of places, {gap:+.0f} % of {low:.2f} m"
    what = f"sigma up to which {100 * CORRECT:.0f} % of the associations are right, against Mori's formula"
    yield Claim(what, shown, STATED, True)


def claims() -> Iterator[Claim]:
    """What the map says, where the truth is known."""
    yield from _blair()
    yield from _riccati()
    yield from _m_of_n()
    yield from _mori()
