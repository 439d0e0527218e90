"""How much each axis changes a value."""

import math

import numpy as np
import pytest
from tests.support.claims import claim_of, envelope_of

from trackbench.subjects.envelope.axes import axes_of
from trackbench.subjects.envelope.claim import Envelope, parts_of
from trackbench.subjects.envelope.config import EnvelopeConfig
from trackbench.subjects.envelope.sensitivity import Surface, sensitivities

AXES = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 3, "scale": "log"},
}


def test_a_linear_function_is_shared_out_by_the_squares_of_its_slopes():
    made = envelope_of(claim_of(AXES, {"ekf": lambda x, y: 1.0 + 3.0 * x - 4.0 * y}))
    (found,) = sensitivities(made)
    assert found.error == pytest.approx(0.0, abs=1e-9)
    assert found.first == pytest.approx([9 / 25, 16 / 25], abs=0.01)
    assert found.total == pytest.approx([9 / 25, 16 / 25], abs=0.01)
    swings = [swing for _, swing in found.swings]
    assert [swing.change for swing in swings] == pytest.approx([3.0, -4.0])


def test_a_product_interacts():
    """x y on the unit square: each alone 3/7, their interaction 1/7."""
    made = envelope_of(claim_of(AXES | {"r": {**AXES["r"], "levels": 7}}, {"ekf": lambda x, y: 2.0 + x * y}))
    (found,) = sensitivities(made)
    assert found.first == pytest.approx([3 / 7, 3 / 7], abs=0.02)
    assert found.total == pytest.approx([4 / 7, 4 / 7], abs=0.02)


def test_the_indices_of_ishigami():
    """Closed form: Ishigami and Homma (1990), a = 7, b = 0.1."""
    axes = axes_of(
        EnvelopeConfig.model_validate(
            {"axes": {name: {"key": f"truth.{name}", "from": -math.pi, "to": math.pi} for name in "abc"}}
        )
    )
    shares = np.stack(np.meshgrid(*[np.linspace(0, 1, 11)] * 3), axis=-1).reshape(-1, 3)
    x = (2 * shares - 1) * math.pi
    values = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    surface = Surface(axes, [tuple(axis.at(s) for axis, s in zip(axes, row, strict=True)) for row in shares], values)
    first, total = surface.sobol_indices()
    np.testing.assert_allclose(first, [0.3139, 0.4424, 0.0], atol=0.02)
    np.testing.assert_allclose(total, [0.5576, 0.4424, 0.2437], atol=0.02)


def test_the_error_is_that_of_leaving_each_cell_out():
    points = [(q, r) for q in (1.0, 1.5, 2.0, 3.0) for r in (0.1, 1.0, 10.0)]
    axes = claim_of(AXES, {"ekf": lambda x, y: 1.0}).axes
    values = np.random.default_rng(1).standard_normal(len(points))
    apart = []
    for i in range(len(points)):
        kept = [n for n in range(len(points)) if n != i]
        surface = Surface(axes, [points[n] for n in kept], values[kept])
        place = np.array([[axis.share(v) for axis, v in zip(axes, points[i], strict=True)]])
        apart.append(float(surface(place)[0] - values[i]))
    expected = math.sqrt(np.mean(np.square(apart))) / np.std(values)
    assert Surface(axes, points, values).error == pytest.approx(expected, rel=1e-6)


def test_noise_explains_nothing():
    noise = np.random.default_rng(0)
    made = envelope_of(claim_of(AXES, {"ekf": lambda x, y: 1.0 + noise.random()}))
    (found,) = sensitivities(made)
    assert found.error > 0.25
    assert found.first == ()


def test_choices_are_equally_likely_and_as_far_apart():
    """Values 0, 0 and 3 of a choice, and a slope of 1: variances 2 and 1/12."""
    axes = {"q": AXES["q"], "world": {"key": "truth.world", "choices": ["a", "b", "c"]}}
    made = envelope_of(claim_of(axes, {"ekf": lambda x, world: 1.0 + x + 3.0 * (world == 1.0)}), spread=0.5)
    (found,) = sensitivities(made)
    assert found.first == pytest.approx([1 / 25, 24 / 25], abs=0.02)
    swing = found.swings[1][1]
    assert (swing.stop, swing.change) == ("c", pytest.approx(3.0))
    # They are picked after looking at their values.
    assert swing.reach is None


def swing_of(sizes):
    """The swing of an axis of two values, 1 and 2, of the runs of the same noise, so many at each."""
    claim = claim_of({"q": AXES["q"] | {"levels": 2}}, {"ekf": lambda x: 1.0 + x})
    noise = np.random.default_rng(0).standard_normal(max(sizes))
    parts = [1.0 + cell + noise[:size] - noise[:size].mean() for cell, size in enumerate(sizes)]
    (found,) = sensitivities(Envelope(claim, parts_of([(cell, 0, part) for cell, part in enumerate(parts)])))
    return parts, found.swings[0][1]


def test_a_swing_between_the_same_runs_is_without_their_noise():
    _, swing = swing_of((50, 50))
    assert swing.change == pytest.approx(1.0)
    assert swing.reach == pytest.approx(0.0, abs=1e-9)


def test_a_swing_between_other_numbers_of_runs_is_that_of_independent_ones():
    """2.0639 is the quantile of the t distribution of 24 degrees of freedom."""
    (low, high), swing = swing_of((25, 200))
    assert swing.change == pytest.approx(1.0)
    expected = 2.0639 * math.sqrt(low.var(ddof=1) / 25 + high.var(ddof=1) / 200)
    assert swing.reach == pytest.approx(expected, rel=1e-4)
