"""The values of ``human`` that are fitted: acceleration and wander."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from trackbench.truth.config import HUMAN, Drivers

from . import statistics
from .simulated import congested


class Effect(NamedTuple):
    """One of the two processes: its keys in the options, and the statistics that the fit makes alike."""

    size: str
    time: str
    alike: tuple[str, ...]
    """The first is met exactly for each correlation time; the others choose among the times."""


EFFECTS = (
    Effect("acceleration_rms_mps2", "acceleration_time_s", ("rms", "median", "p90", "p99", "small", "time")),
    Effect("wander_m", "wander_time_s", ("side", "side_speed")),
)
#: Correlation times that are tried, s.
TIMES_S = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
#: Times whose misfit is this little above the smallest fit as well: the longest of them, whose jerk is least, is taken.
AS_WELL = 0.02
#: Simulations for each, in which the sizes are brought to the recorded ones.
STEPS = 3


class Trial(NamedTuple):
    """A correlation time, the size that it takes, and how far off the statistics are."""

    time_s: float
    size: float
    off: float
    """RMS of the logarithms of simulated over recorded statistics."""


def fit(recorded: Mapping[str, float], speeds: Sequence[float]) -> tuple[Drivers, list[list[Trial]]]:
    """The drivers whose statistics are those recorded, and what was tried of each effect.

    The effects are fitted in the same simulations: nobody accelerates for the sake of a place in the lane.
    """
    trials: list[list[Trial]] = [[] for _ in EFFECTS]
    for time_s in TIMES_S:
        drivers = HUMAN.model_copy(update={effect.size: recorded[effect.alike[0]] / 2 for effect in EFFECTS})
        drivers = drivers.model_copy(update={effect.time: time_s for effect in EFFECTS})
        for _ in range(STEPS):
            simulated = statistics.of(congested(drivers, speeds))
            ratios = {effect.size: recorded[effect.alike[0]] / simulated[effect.alike[0]] for effect in EFFECTS}
            tried, drivers = drivers, _scaled(drivers, ratios)
        for effect, kept in zip(EFFECTS, trials, strict=True):
            off = [math.log(simulated[key] / recorded[key]) ** 2 for key in effect.alike]
            kept.append(Trial(time_s, getattr(tried, effect.size), math.sqrt(sum(off) / len(off))))
    best = [
        max(kept, key=lambda trial: (trial.off < min(t.off for t in kept) + AS_WELL, trial.time_s)) for kept in trials
    ]
    values = {
        key: value
        for effect, trial in zip(EFFECTS, best, strict=True)
        for key, value in ((effect.size, round(trial.size, 2)), (effect.time, trial.time_s))
    }
    return HUMAN.model_copy(update=values), trials


def _scaled(drivers: Drivers, ratios: Mapping[str, float]) -> Drivers:
    return drivers.model_copy(update={key: getattr(drivers, key) * ratio for key, ratio in ratios.items()})
