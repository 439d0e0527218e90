"""Correct trackers, on which any finding is wrong."""

from __future__ import annotations

from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.trackers import builtin
from trackbench.trackers.raw import RawTracker

from .cholesky_ukf import CholeskyUkf
from .filterpy_ekf import FilterPyEkf, FilterPyUkf
from .mutant import Make
from .other_ekfs import AdaptiveEkf, BiasEkf, InformationFilter, PlainImm
from .other_ukfs import CubatureFilter, ScaledUkf, SquareRootUkf
from .plain import Array, Belief
from .plain_ekf import PlainEkf
from .plain_kf import PlainKf
from .plain_ukf import PlainUkf
from .sampling_filters import EnsembleFilter, ParticleFilter, SquareRootEnsemble

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "alpha_beta.py"
STARTS = ("first_measurement", "two_measurements")
RADIAL = {"from": "first_measurement", "velocity": "radial"}

#: Driving noise of each motion model, from calm to lively: acceleration m/s^2 or jerk m/s^3, yaw acceleration rad/s^2.
TUNINGS: dict[str, list[dict[str, float]]] = {
    "cv": [{"acceleration_sigma_mps2": a} for a in (1.5, 3.0, 6.0)],
    "ca": [{"jerk_sigma_mps3": jerk} for jerk in (2.0, 4.0, 6.0)],
    "ctrv": [
        {"acceleration_sigma_mps2": a, "yaw_acceleration_sigma_radps2": w}
        for a, w in ((1.5, 0.3), (3.0, 0.5), (6.0, 1.0))
    ],
    "ctra": [
        {"jerk_sigma_mps3": jerk, "yaw_acceleration_sigma_radps2": w}
        for jerk, w in ((2.0, 0.3), (4.0, 0.5), (6.0, 1.0))
    ],
}
MOTIONS = {
    builtin.kf: ("cv", "ca"),
    builtin.ekf: ("cv", "ca", "ctrv", "ctra"),
    builtin.ukf: ("cv", "ctrv", "ctra"),
    builtin.ckf: ("cv", "ctrv"),
}
UKF_RULES: dict[str, dict[str, Any]] = {
    "not augmented": {"augmented": False},
    "classic": {"sigma_points": "classic"},
    "classic, not augmented": {"sigma_points": "classic", "augmented": False},
}


def _alpha_beta() -> type:
    spec = spec_from_file_location("alpha_beta", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.AlphaBeta


def _built_in() -> dict[str, Make]:
    made: dict[str, Make] = {}
    for make, motions in MOTIONS.items():
        for motion, start in product(motions, STARTS):
            if (make, motion, start) == (builtin.ekf, "ctra", "first_measurement"):
                # Linearised about a course of which one reading says nothing, it can lose its target for seconds.
                continue
            for number, tuning in enumerate(TUNINGS[motion]):
                name = f"{make.__name__} {motion} {('calm', 'usual', 'lively')[number]}, {start}"
                made[name] = partial(make, motion=motion, initial=start, **tuning)
    usual = TUNINGS["ctrv"][1]
    for rule, options in UKF_RULES.items():
        # With its negative central weight the classic rule can lose a target of which it knew too little at first.
        for start in STARTS if "classic" not in rule else STARTS[1:]:
            made[f"ukf ctrv {rule}, {start}"] = partial(builtin.ukf, motion="ctrv", initial=start, **usual, **options)
    for make in (builtin.ekf, builtin.ukf):
        made[f"{make.__name__} ctrv usual, radial"] = partial(make, motion="ctrv", initial=RADIAL, **usual)
        made[f"{make.__name__} cv usual, radial"] = partial(make, motion="cv", initial=RADIAL, **TUNINGS["cv"][1])
    return made


def _plain() -> dict[str, Make]:
    trackers = (PlainEkf, PlainUkf, PlainKf, CholeskyUkf, FilterPyEkf, FilterPyUkf)
    return {
        f"{tracker.__name__} {start}": partial(tracker, start=start) for tracker, start in product(trackers, STARTS)
    }


#: Particles are where the target is after a turn without measurements; a Gaussian reaches farther than its samples.
LIVELY = {"acceleration_sigma": 6.0}
#: Filters of other kinds: with samples, with a hidden state, with a noise or a mode that adapts itself.
OTHERS: dict[str, Make] = {
    "particles": partial(ParticleFilter, **LIVELY),
    "particles, seeded": partial(ParticleFilter, seed=3, **LIVELY),
    "ensemble": EnsembleFilter,
    "ensemble, seeded": partial(EnsembleFilter, seed=3),
    "square-root ensemble": SquareRootEnsemble,
    "range bias": BiasEkf,
    "azimuth bias": partial(BiasEkf, component=1, bias_sigma=0.02),
    "adaptive process noise": AdaptiveEkf,
    "information filter": InformationFilter,
    "imm": PlainImm,
    "ukf alpha 0.001": ScaledUkf,
    "ukf alpha 1, kappa 1": partial(ScaledUkf, alpha=1.0, kappa=1.0),
    "cubature filter": CubatureFilter,
    "square-root ukf": SquareRootUkf,
}

CORRECT: dict[str, Make] = {**_plain(), **_built_in(), **OTHERS, "alpha_beta": _alpha_beta()}


class FadingMemory(PlainEkf):
    """No process noise: each step multiplies the covariance, here by so little that the memory is several seconds."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        x, P = super().predict(x, P, dt)
        return x, 1.01 * P

    def process_noise(self, x: Array, dt: float) -> Array:
        return np.zeros((4, 4))


#: Trackers whose covariance does not fit their errors, without a fault that has a name. While measurements are missing,
#: that of ``raw`` stays.
UNBELIEVABLE: dict[str, Make] = {"raw": RawTracker, "fading_memory": FadingMemory}

#: By name, the kind of the only sensor that a correct tracker reads, and the tracker: it leaves the other out on
#: purpose, and a finding is wrong unless it says so. The sensors are to be named after their kind.
ONE_SENSOR: dict[str, tuple[str, Make]] = {
    f"{make.__name__} {motion}, {kind} alone": (
        kind,
        partial(make, motion=motion, initial="two_measurements", sensors=[kind], **TUNINGS[motion][1]),
    )
    for make, motion, kind in product((builtin.ekf, builtin.ukf), ("cv", "ctrv"), ("radar", "lidar"))
}
