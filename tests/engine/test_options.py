"""Options of motion models as inputs of kernels: other values need no other kernel, and members may have their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engine import agreement
from tests.engine.agreement import drive, of_modes
from tests.support.scenes import NOISE
from tests.support.steps import step_of

from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.engine.machine import KernelCache, Processor
from trackbench.filters import Belief, select
from trackbench.trackers.builtin import build, filter_of
from trackbench.trackers.config import FilterConfig

BATCH = 12
#: What a search varies: the entry, and the keys of which each member has its own values.
SEARCHED: dict[str, tuple[dict[str, Any], dict[str, tuple[float, float]]]] = {
    "ekf-cv": ({"filter": "ekf", "motion": "cv", **NOISE["cv"]}, {"acceleration_sigma_mps2": (0.5, 4.0)}),
    "ukf-ctrv": (
        {"filter": "ukf", "motion": "ctrv", **NOISE["ctrv"]},
        {"acceleration_sigma_mps2": (0.5, 4.0), "measurement_noise.lidar.position_sigma_m": (0.1, 0.5)},
    ),
    "ekf-imm": (
        of_modes("ekf", "cv", "ctra"),
        {"motion.imm.1.jerk_sigma_mps3": (0.5, 4.0), "motion.stay_s.0": (1.0, 9.0), "motion.stay_s.1": (1.0, 9.0)},
    ),
}


class CountingProcessor(Processor):
    """Counts what it compiles."""

    compiled = 0

    def object_code(self, text: str) -> bytes:
        self.compiled += 1
        return super().object_code(text)


@pytest.fixture
def counted(kernels: Kernels, tmp_path: Path) -> Kernels:
    """Kernels of which none is kept from before."""
    return Kernels(CountingProcessor(), KernelCache(tmp_path))


def combined(entry: FilterConfig, columns: dict[str, Any]) -> FilterConfig:
    """The entry with the value, or the values ``(batch,)``, of some noise levels."""
    noise: dict[str, dict[str, Any]] = {}
    motion: Any = entry.motion
    for key, column in columns.items():
        *path, option = key.split(".")
        if path[:1] == ["measurement_noise"]:
            noise.setdefault(path[1], {})[option] = column
        elif path == ["motion", "stay_s"]:
            stay_s = [*motion.stay_s[: int(option)], column, *motion.stay_s[int(option) + 1 :]]
            motion = motion.model_copy(update={"stay_s": stay_s})
        elif path:
            models = list(motion.imm)
            models[int(path[2])] = models[int(path[2])].model_copy(update={option: column})
            motion = motion.model_copy(update={"imm": models})
        else:
            motion = motion.model_copy(update={option: column})
    return entry.model_copy(update={"motion": motion, "measurement_noise": noise})


def own_values(name: str, seed: int = 1) -> tuple[FilterConfig, dict[str, np.ndarray]]:
    """The entry and for each key the values of the members."""
    keys, limits = SEARCHED[name]
    random = np.random.default_rng(seed)
    drawn = {key: random.uniform(*interval, BATCH) for key, interval in limits.items()}
    return FilterConfig.model_validate(keys), drawn


@pytest.mark.parametrize("name", SEARCHED)
def test_fifty_values_need_no_other_kernel(name: str, counted: Kernels) -> None:
    keys, limits = SEARCHED[name]
    motion_keys = [key for key in limits if not key.startswith("measurement_noise")]
    entry = FilterConfig.model_validate(keys)
    scan = drive(1, BATCH, ["lidar"]).scans[0]
    made = set()
    for number in range(50):
        values = {key: np.array(0.5 + 0.1 * number) for key in motion_keys}
        filter = filter_of(combined(entry, {key: float(value) for key, value in values.items()}))
        fused = FusedFilter(filter, counted)
        belief = filter.begin(lambda model: _anywhere(len(model.components)))
        cartesian = fused.step(belief, 0.1, scan).cartesian
        assert agreement.of_gaussians(cartesian, step_of(filter, belief, 0.1, scan).cartesian) < agreement.LIMIT
        assert fused.used.why_numpy == ""
        made.add(cartesian.covariance.tobytes())
    assert len(made) == 50
    assert counted._processor.compiled == 1
    assert len(counted._kernels) == 1


@pytest.mark.parametrize("name", SEARCHED)
def test_each_member_may_have_its_own(name: str) -> None:
    entry, drawn = own_values(name)
    whole = combined(entry, drawn)
    of, by_kernels = build(whole).tracker, build(whole).tracker
    object.__setattr__(by_kernels, "engine", "fused")
    angular = tuple(motion.angular for motion in of.filter.motions)
    state = other = None
    for scan in drive(25, BATCH, ["lidar", "radar"]).scans:
        state, said = of.step(state, scan)
        other, found = by_kernels.step(other, scan)
        # A fit to a few measurements is not as well conditioned as a step.
        assert agreement.apart(other.belief, state.belief, angular) < 10 * agreement.LIMIT
        there = np.isfinite(said.mean[0])
        np.testing.assert_array_equal(np.isfinite(found.mean[0]), there)
    assert np.all(state.started)
    assert by_kernels.engine_used.why_numpy == ""


@pytest.mark.parametrize("name", SEARCHED)
def test_a_member_with_its_own_is_as_with_those_for_all(name: str) -> None:
    """To the last bit."""
    entry, drawn = own_values(name)
    own = _last_belief(combined(entry, drawn))
    for i in range(0, BATCH, 5):
        alike = _last_belief(combined(entry, {key: float(values[i]) for key, values in drawn.items()}))
        assert _bits(select(own, np.array([i]))) == _bits(select(alike, np.array([i])))


def _anywhere(size: int, batch: int = BATCH) -> Any:
    random = np.random.default_rng(size)
    root = random.normal(size=(size, size, batch))
    mean = random.normal(size=(size, batch)) + np.array([30.0, 5.0, 8.0, 0.5, 0.1, 0.2])[:size, None]
    return agreement.Gaussian(mean, np.einsum("ik...,jk...->ij...", root, root) * 0.1)


def _last_belief(entry: FilterConfig) -> Any:
    made, state = build(entry).tracker, None
    object.__setattr__(made, "engine", "fused")
    for scan in drive(15, BATCH, ["lidar", "radar"]).scans:
        state, _ = made.step(state, scan)
    return state.belief


def _bits(belief: Any) -> list[bytes]:
    if isinstance(belief, Belief):
        return [belief.mean.tobytes(), belief.covariance.tobytes()]
    return [belief.probability.tobytes(), *(part for mode in belief.modes for part in _bits(mode))]
