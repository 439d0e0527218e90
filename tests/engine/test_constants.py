"""What a user's model reads: it is compiled only if all of that is known to be constant, and read before every run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from tests.engine.honest_models import KNOWN, SET_ASIDE
from tests.engine.odd_factors import COUNTERS, INPUT, RANDOM, STATELESS, Factor
from tests.engine.odd_points import OWN_STATE, WITHOUT_STATE, Motion, faster
from tests.engine.parameter_places import PLACES
from tests.support.scenes import scan

from trackbench.base.types import Array, Gaussian
from trackbench.engine.equations import EngineUsed
from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.engine.user_equations import Comparisons
from trackbench.filters import (
    CUBATURE,
    Belief,
    ExtendedKalmanFilter,
    InteractingMultipleModel,
    SigmaPointFilter,
    scaled_points,
)
from trackbench.models.motion import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS, Lidar

MEMBERS, STEPS = 12, 40
STRAIGHT, AGILE = (ConstantVelocity(acceleration_sigma_mps2=sigma) for sigma in (1.0, 4.0))
POINTS = scaled_points(1.0, 2.0, -1.0)
FILTERS: dict[str, Callable[[ConstantVelocity], Any]] = {
    "ekf": ExtendedKalmanFilter,
    "ukf": lambda motion: SigmaPointFilter(motion, POINTS),
    "ckf": lambda motion: SigmaPointFilter(motion, CUBATURE, augmented=False),
    "imm": lambda motion: InteractingMultipleModel(
        (SigmaPointFilter(motion, POINTS), SigmaPointFilter(AGILE, POINTS)), (5.0, 2.0), (0.5, 0.5)
    ),
}


def by_factor(factor: Factor) -> Motion:
    """Straight on, in a time that runs faster by a factor, of the states and the time step."""
    return lambda x, dt: faster(x, dt, factor(x, dt))


def motion_of(moved: Motion) -> ConstantVelocity:
    class Odd(ConstantVelocity):
        linear: ClassVar[bool] = False

        def transition(self, x: Array, dt: float) -> Array:
            result: Array = moved(x, dt)
            return result

    return Odd(acceleration_sigma_mps2=1.0)


def sensor_of(moved: Motion) -> type[Lidar]:
    """Sees where its target is soon."""

    class Odd(Lidar):
        position_sigma_m: float = 0.15

        @classmethod
        def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
            return super().measure(moved(target, 0.1), pose, velocity)

    return Odd


def start() -> Belief:
    state = np.linspace([0.0, -30.0, 2.0, 1.0], [20.0, 30.0, 12.0, 3.0], MEMBERS, axis=-1)
    return Belief(state, np.stack([np.eye(4)] * MEMBERS, axis=-1))


def path_by(filter: Any, kind: str = "lidar", updates: Any = None) -> Array:
    """The estimates of objects that drive straight on, made in steps, and by predictions and updates in turn.

    ``updates``: the filter that makes the updates; the same unless given.
    """
    first = start()
    belief = filter.begin(lambda motion: Gaussian(first.mean, first.covariance))
    means = []
    for number in range(1, STEPS):
        position = first.mean[:2] + 0.1 * number * first.mean[2:] + 0.1 * np.sin(number)
        seen = scan("lidar", 0.1 * number, position)._replace(kind=kind)
        if number % 4:
            belief = filter.step(belief, 0.1, seen).update.belief
        else:
            belief = (updates or filter).update(filter.predict(belief, 0.1), seen).belief
        means.append(filter.cartesian(belief).mean)
    return np.array(means)


#: What has the odd equations.
Place = Literal["motion", "sensor", "both"]


def driven(
    moved: Motion, kernels: Kernels | None, of: Place = "motion", filter: str = "ekf"
) -> tuple[Array, EngineUsed]:
    """The estimates with an odd motion model or sensor, and what computed them; without kernels NumPy."""
    return driven_by(moved, moved, kernels, of, filter)


def driven_by(moved: Motion, seen: Motion, kernels: Kernels | None, of: Place, filter: str) -> tuple[Array, EngineUsed]:
    """The same, with other equations of the motion model than of the sensor."""
    plain = FILTERS[filter](STRAIGHT if of == "sensor" else motion_of(moved))
    by = plain if kernels is None else FusedFilter(plain, kernels)
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        patch.setitem(SENSOR_MODELS.found, "odd", sensor_of(seen))
        # An update alone has nothing of a motion model.
        means = path_by(by, "lidar" if of == "motion" else "odd", plain if of == "motion" else by)
        return means, EngineUsed("numpy") if kernels is None else by.used


def cases(names: Iterable[str], fast: tuple[Place, str], slow: Sequence[tuple[Place, str]]) -> pytest.MarkDecorator:
    """Each with the odd equations in one place and with one filter, and slow ones with others."""
    return pytest.mark.parametrize(
        ("name", "of", "filter"),
        [
            *((name, *fast) for name in names),
            *(pytest.param(name, *case, marks=pytest.mark.slow) for name in names for case in slow),
        ],
    )


#: Predictions have only the odd equations of the motion model, updates those of the sensor, steps both.
BOTH: tuple[Place, str] = ("both", "ekf")
SEVERAL: Sequence[tuple[Place, str]] = (("motion", "imm"), ("sensor", "imm"))


@cases(PLACES, BOTH, SEVERAL)
def test_a_parameter_that_is_changed_between_two_runs_counts(
    kernels: Kernels, name: str, of: Place, filter: str
) -> None:
    """Or NumPy computes the model, and it is said."""
    factor, change = PLACES[name]()
    paths, engines = [], []
    for value in (1.0, 1.5, 1.0):
        change(value)
        expected, _ = driven(by_factor(factor), None, of, filter)
        path, used = driven(by_factor(factor), kernels, of, filter)
        engines.append(used)
        np.testing.assert_allclose(path, expected, rtol=1e-10, atol=1e-10)
        assert used == EngineUsed("fused") or (used.engine != "fused" and used.why_numpy and used.of_user)
        paths.append(path)
    assert not np.allclose(paths[0], paths[1])
    # Machine code that was found to give other numbers is not used again, which ``used`` says.
    if engines[0] == engines[2]:
        np.testing.assert_array_equal(paths[0], paths[2])


FACTORS = {
    **{name: lambda make=make: by_factor(make()) for name, make in {**COUNTERS, **INPUT}.items()},
    **{name: partial(by_factor, factor) for name, factor in STATELESS.items()},
}
MOTIONS = {**OWN_STATE, **{name: lambda moved=moved: moved for name, moved in WITHOUT_STATE.items()}}


def differs_only_where_it_is_said(kernels: Kernels, make: Callable[[], Motion], of: Place, filter: str) -> None:
    expected, _ = driven_by(make(), make(), None, of, filter)
    path, used = driven_by(make(), make(), kernels, of, filter)
    if used.invalid and of == "both":
        # One of them may be right.
        for place in ("motion", "sensor"):
            differs_only_where_it_is_said(Kernels(), make, place, filter)
    # Where machine code turned out to be wrong, a run is computed again by NumPy.
    assert used.invalid or np.allclose(path, expected, rtol=1e-10, atol=1e-10, equal_nan=True)
    # Members of which a trace does not hold are computed again without a word.
    assert used.why_numpy or (not used.invalid and (used.engine == "fused") == (used.again == 0))
    assert used.of_user == bool(used.why_numpy)


@cases(FACTORS, BOTH, SEVERAL)
def test_an_odd_model_differs_from_numpy_only_where_it_is_said(
    kernels: Kernels, name: str, of: Place, filter: str
) -> None:
    differs_only_where_it_is_said(kernels, FACTORS[name], of, filter)


@cases(MOTIONS, ("motion", "ukf"), [("sensor", "ukf"), *product(("motion", "sensor"), ("ckf", "imm"))])
def test_a_model_that_is_odd_with_sigma_points_does_so_too(kernels: Kernels, name: str, of: Place, filter: str) -> None:
    differs_only_where_it_is_said(kernels, MOTIONS[name], of, filter)


@pytest.mark.parametrize(
    ("of", "filter"),
    [("motion", "ekf"), ("sensor", "ekf"), *(pytest.param(*case, marks=pytest.mark.slow) for case in SEVERAL)],
)
@pytest.mark.parametrize("name", RANDOM)
def test_what_draws_or_asks_the_time_is_left_to_numpy(kernels: Kernels, name: str, of: Place, filter: str) -> None:
    _, used = driven(by_factor(RANDOM[name]()), kernels, of, filter)
    # The rest of a filter with an odd sensor is compiled.
    assert used.engine == ("numpy" if of == "motion" else "fused and numpy")
    assert used.of_user
    assert not used.invalid


def test_a_model_may_ask_for_its_own_class_and_write_messages(kernels: Kernels) -> None:
    class Gain:
        value = 1.1

        def factor(self, x: Array, dt: float) -> float:
            if self.value < 0.0:
                raise ValueError(f"{type(self).__name__} of {self.value}, {self.__class__.__name__}")
            return type(self).value

    path, used = driven(by_factor(Gain().factor), kernels)
    np.testing.assert_allclose(path, driven(by_factor(Gain().factor), None)[0], rtol=1e-10)
    assert used == EngineUsed("fused")


def test_few_honest_models_are_left_to_numpy(kernels: Kernels) -> None:
    """At most 5 % of those that people write, each compiled to the same numbers."""
    left: dict[str, str] = {}
    for kind in (*KNOWN, *SET_ASIDE):
        # What has no number by itself.
        options = {name: kind.model_fields[name].default for name in kind.driving_noise}
        model = kind(**{name: 1.0 for name, default in options.items() if not isinstance(default, float)})
        more = len(model.components) - 4
        belief = Belief(
            np.concatenate([start().mean, np.full((more, MEMBERS), 0.1)]),
            np.stack([np.eye(4 + more)] * MEMBERS, axis=-1),
        )
        filter = FusedFilter(ExtendedKalmanFilter(model), kernels)
        result, expected = (each.predict(belief, 0.1) for each in (filter, filter.filter))
        np.testing.assert_allclose(result.mean, expected.mean, rtol=1e-12, atol=1e-12)
        # Coordinates of a map; each step is compared with NumPy.
        far = belief._replace(mean=belief.mean + np.array([5e6, 5e5, *[0.0] * (more + 2)])[:, None])
        kernels.comparisons = Comparisons(np.random.default_rng(1))
        for number in range(4):
            filter.step(far, 0.1, scan("lidar", 0.1, far.mean[:2] + 0.1 * np.sin(number)))
        if filter.used != EngineUsed("fused"):
            left[kind.__name__] = filter.used.why_numpy
    assert len(KNOWN) + len(SET_ASIDE) == 30
    assert set(left) <= {"Cached"}, left
