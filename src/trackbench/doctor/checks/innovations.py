"""What do the innovations look like on a drive with noise?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.exhibits import Innovations, watch
from trackbench.doctor.findings import Check, Outcome
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array, Mask

#: The drive in which most can be wrong with them.
COURSE = "azimuth_crossing"


def innovations(bench: Bench) -> Outcome:
    """Mean, whiteness, size and relation to the bearing, of what each measurement was worth to the tracker."""
    outcome = Outcome()
    for course, _ in bench.courses:
        if course.name == COURSE:
            outcome.checks += [_check(one) for one in watch(bench.make, course).innovations]
    return outcome


def _check(of: Innovations) -> Check:
    model = SENSOR_MODELS[of.kind]
    mean = np.nanmean(of.taken / of.sigma[:, None], axis=1)
    turns = sum(int(np.sum(np.abs(of.taken[i]) > np.pi)) for i in model.angular)
    nis = float(np.nanmean(np.sum(of.white**2, axis=0)))
    parts = [
        "mean "
        + ", ".join(f"{name.replace('_', ' ')} {value:.2g}" for name, value in zip(of.components, mean, strict=True))
        + " sigma",
        f"NIS {nis:.3g} of {len(of.sigma)}",
        f"lag-one autocorrelation {_autocorrelation(of.white):.2g}",
    ]
    if model.angular:
        parts.append(f"{turns} of {of.taken.shape[1]} by more than pi")
    question = f"Are the innovations of {of.sensor} small, where the target crosses the azimuth of pi too?"
    # A mean or a colour may be what the motion model costs in this drive; a whole turn never is.
    return Check(f"innovations.{of.sensor}", question, turns == 0, "; ".join(parts))


def _autocorrelation(white: Array) -> float:
    """Of successive whitened innovations."""
    known: Mask = np.asarray(np.isfinite(white).all(axis=0))
    now, before = white[:, 1:], white[:, :-1]
    both: Mask = np.asarray(known[1:] & known[:-1])
    power = float(np.sum(now[:, both] ** 2))
    return float(np.sum(now[:, both] * before[:, both])) / power if power > 0.0 else 0.0
