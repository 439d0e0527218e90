"""What a user's model reads: it is compiled only if all of that is known to be constant, and read before every run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from tests.engine.honest_models import KNOWN, SET_ASIDE
from tests.engine.odd_factors import COUNTERS, INPUT, RANDOM, STATELESS
from tests.engine.parameter_places import PLACES
from tests.support.scenes import scan

from trackbench.base.types import Array
from trackbench.engine.equations import EngineUsed
from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.filters import Belief, ExtendedKalmanFilter, bare
from trackbench.models.motion import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS, Lidar

MEMBERS, STEPS = 12, 40


def model_of(factor: Callable[[Any, Any], Any]) -> ConstantVelocity:
    """A motion model whose time runs faster by a factor, of the state and the time step."""

    class Faster(ConstantVelocity):
        linear: ClassVar[bool] = False

        def transition(self, x: Array, dt: float) -> Array:
            return super().transition(x, dt * factor(x, dt))

    return Faster(acceleration_sigma_mps2=1.0)


def start() -> Belief:
    state = np.linspace([0.0, -30.0, 2.0, 1.0], [20.0, 30.0, 12.0, 3.0], MEMBERS, axis=-1)
    return Belief(state, np.stack([np.eye(4)] * MEMBERS, axis=-1))


def driven(factor: Callable[[Any, Any], Any], kernels: Kernels | None) -> tuple[Array, EngineUsed]:
    """Where many predictions lead, and what computed them; without kernels NumPy."""
    plain = ExtendedKalmanFilter(model_of(factor))
    filter: Any = plain if kernels is None else FusedFilter(plain, kernels)
    belief = start()
    for _ in range(STEPS):
        belief = filter.predict(belief, 0.1)
    return belief.mean, EngineUsed("numpy") if kernels is None else filter.used


@pytest.mark.parametrize("place", PLACES)
def test_a_parameter_that_is_changed_between_two_runs_counts(
    kernels: Kernels, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or NumPy computes the model, and it is said."""
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path))
    factor, change = PLACES[place]()
    ends = []
    for value in (1.0, 1.5, 1.0):
        change(value)
        expected, _ = driven(factor, None)
        end, used = driven(factor, kernels)
        np.testing.assert_allclose(end, expected, rtol=1e-12, atol=1e-12)
        assert used == EngineUsed("fused") or (used.engine == "numpy" and used.why_numpy and used.of_user)
        ends.append(end)
    assert not np.allclose(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[2])


ODD = {**COUNTERS, **INPUT, **{name: partial(lambda factor: factor, factor) for name, factor in STATELESS.items()}}


@pytest.mark.parametrize("name", ODD)
def test_an_odd_model_differs_from_numpy_only_where_it_is_said(
    kernels: Kernels, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path))
    expected, _ = driven(ODD[name](), None)
    end, used = driven(ODD[name](), kernels)
    # Where machine code turned out to be wrong, a run is computed again by NumPy.
    assert used.invalid or np.allclose(end, expected, rtol=1e-12, atol=1e-12)
    assert used.why_numpy or (used.engine != "numpy" and not used.invalid)
    assert used.of_user == bool(used.why_numpy)


@pytest.mark.parametrize("name", RANDOM)
def test_a_model_of_chance_or_time_is_left_to_numpy(kernels: Kernels, name: str) -> None:
    _, used = driven(RANDOM[name](), kernels)
    assert used.engine == "numpy"
    assert used.of_user


def test_few_honest_models_are_left_to_numpy(kernels: Kernels) -> None:
    """At most 5 % of those that people write, each compiled to the same numbers."""
    left: dict[str, str] = {}
    for kind in (*KNOWN, *SET_ASIDE):
        model = kind(**{name: 1.0 for name in kind.driving_noise if kind.model_fields[name].is_required()})
        more = len(model.components) - 4
        belief = Belief(
            np.concatenate([start().mean, np.full((more, MEMBERS), 0.1)]),
            np.stack([np.eye(4 + more)] * MEMBERS, axis=-1),
        )
        filter = FusedFilter(ExtendedKalmanFilter(model), kernels)
        result, expected = (each.predict(belief, 0.1) for each in (filter, filter.filter))
        np.testing.assert_allclose(result.mean, expected.mean, rtol=1e-12, atol=1e-12)
        if filter.used != EngineUsed("fused"):
            left[kind.__name__] = filter.used.why_numpy
    assert len(KNOWN) + len(SET_ASIDE) == 30
    assert set(left) <= {"Cached"}, left


OF_SENSORS = {
    **{
        name: COUNTERS[name] for name in ("list entry", "array", "class", "closure cell", "rarely, list", "deque entry")
    },
    **{name: RANDOM[name] for name in ("numpy.random", "Generator", "time")},
    **{name: partial(lambda factor: factor, STATELESS[name]) for name in ("if all", "middle members", "shape[-1]")},
    **{name: partial(lambda factor: factor, STATELESS[name]) for name in ("all along members", "where", "isinstance")},
}


@pytest.mark.parametrize("name", OF_SENSORS)
def test_an_odd_sensor_differs_from_numpy_only_where_it_is_said(
    kernels: Kernels, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = []
    for engine in ("numpy", "fused"):
        factor = OF_SENSORS[name]()

        class Odd(Lidar):
            position_sigma_m: float = 0.15

            @classmethod
            def measure(cls, target: Array, pose: Array, velocity: Array, factor: Any = factor) -> Array:
                return super().measure(target, pose, velocity) * factor(target, 0.1)

        monkeypatch.setitem(SENSOR_MODELS.found, "odd", Odd)
        plain = ExtendedKalmanFilter(ConstantVelocity(acceleration_sigma_mps2=1.0))
        filter: Any = plain if engine == "numpy" else FusedFilter(plain, kernels)
        belief = start()
        for number in range(STEPS):
            ahead = plain.predict(belief, 0.1)
            seen = scan("lidar", 0.1 * number, ahead.mean[:2] + 0.1, np.ones(MEMBERS, dtype=bool))
            belief = bare(filter.update(ahead, seen._replace(kind="odd")).belief)
        ends.append(belief.mean)
    used = filter.used
    assert used.invalid or name in RANDOM or np.allclose(*ends, rtol=1e-11, atol=1e-11)
    assert used.why_numpy or (used.engine != "numpy" and not used.invalid)
    assert used.of_user == bool(used.why_numpy)
    assert used.why_numpy or name == "where"
