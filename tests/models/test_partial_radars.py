"""Radars that measure some of range, azimuth and range rate."""

from __future__ import annotations

from itertools import combinations, permutations
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from tests.models.test_sensor_models import situations
from tests.support.scenes import fixed_observer, scan, truth

from trackbench.base.config.key_units import split_key
from trackbench.base.types import FieldOfView
from trackbench.models.sensors import SENSOR_MODELS, Radar
from trackbench.models.sensors.presets import presets, typical
from trackbench.models.sensors.radar import PARTIAL_RADARS
from trackbench.sensing.detections import FALSE_ALARM, sense_hidden, stated_detection
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.multi.intensity import volumes

ALL = Radar.components
SUBSETS = [part for size in (1, 2) for part in combinations(ALL, size)]
every_subset = pytest.mark.parametrize("measures", SUBSETS, ids=[" ".join(part) for part in SUBSETS])
SIGMAS = {
    "range": ("range_sigma_m", 0.3),
    "azimuth": ("azimuth_sigma_deg", 0.5),
    "range_rate": ("range_rate_sigma_mps", 0.1),
}


def options(measures: tuple[str, ...], **more: Any) -> dict[str, Any]:
    return {"rate_hz": 10, "measures": list(measures), **dict(SIGMAS[name] for name in measures), **more}


def kind(measures: tuple[str, ...]) -> str:
    return f"radar({', '.join(measures)})"


@every_subset
def test_measurements_and_jacobian_are_rows_of_the_full_radar(measures: tuple[str, ...]) -> None:
    pose, own, target = situations()
    model, rows = SENSOR_MODELS[kind(measures)], [ALL.index(name) for name in measures]
    np.testing.assert_array_equal(model.measure(target, pose, own), Radar.measure(target, pose, own)[rows])
    np.testing.assert_array_equal(model.jacobian(target, pose, own), Radar.jacobian(target, pose, own)[rows])
    assert [model.components, model.units] == [measures, tuple(Radar.units[i] for i in rows)]
    assert [model.components[i] for i in model.angular] == [name for name in measures if name == "azimuth"]


@every_subset
def test_any_order_is_kept_in_the_order_of_the_full_radar(measures: tuple[str, ...]) -> None:
    for order in permutations(measures):
        for made in (Radar(**options(order)), Radar.model_validate({"type": "radar", **options(order)})):
            assert type(made) is PARTIAL_RADARS[measures]
            assert made.type == made.kind() == kind(measures)
            assert made.components == measures
            np.testing.assert_array_equal(np.diag(made.noise_covariance()), np.square(made.sigmas()))


@pytest.mark.parametrize("order", list(permutations(ALL)))
def test_all_three_are_the_radar_as_it_was(order: tuple[str, ...]) -> None:
    made = Radar(**options(order))
    assert type(made) is Radar
    assert made.type == "radar"
    assert made.components == ALL


@every_subset
def test_a_position_needs_range_and_azimuth(measures: tuple[str, ...]) -> None:
    model = SENSOR_MODELS[kind(measures)]
    seen = scan(kind(measures), 0.0, np.full((len(measures), 3), 0.5), noise=np.eye(len(measures)) * 1e-4)
    placed = np.isfinite(model.position(seen).mean).all()
    assert placed == model.measures_position() == ({"range", "azimuth"} <= {*measures})
    assert model.position(seen).covariance.shape == (2, 2, 3)
    np.testing.assert_array_equal(model.radial_velocity(seen), 0.0)
    assert not model.measures_velocity()


def test_range_and_azimuth_are_converted_as_by_the_full_radar() -> None:
    full = scan("radar", 0.0, np.array([[50.0, 7.0], [0.6, -3.0], [3.0, 0.0]]), pose=(1.0, 2.0, 0.4))
    part = full._replace(
        kind="radar(range, azimuth)", measurement=full.measurement[:2], noise_covariance=full.noise_covariance[:2, :2]
    )
    for ours, theirs in zip(SENSOR_MODELS[part.kind].position(part), Radar.position(full), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@every_subset
def test_what_is_needed_is_what_is_measured(measures: tuple[str, ...]) -> None:
    for name, (key, value) in SIGMAS.items():
        given = options(measures)
        if name in measures:
            del given[key]
        else:
            given[key] = value
        with pytest.raises(ValidationError) as caught:
            Radar.model_validate({"type": "radar", **given})
        (error,) = caught.value.errors()
        assert error["loc"] == (key,)
        if name not in measures:
            assert error["msg"].startswith(f"measures is [{', '.join(measures)}], which does not have it; remove this")


@every_subset
@pytest.mark.parametrize("preset", [name for name, preset in presets().items() if preset.kind == "radar"])
def test_a_preset_and_typical_effects_give_what_is_measured(measures: tuple[str, ...], preset: str) -> None:
    made = Radar.model_validate(
        {
            "type": "radar",
            "rate_hz": 10,
            "measures": list(measures),
            "preset": preset,
            "effects": "typical",
        }
    )
    assert made.components == measures
    assert len(made.sigmas()) == len(measures)
    sizes = [value for effect in typical("radar", measures) for value in effect.values() if isinstance(value, dict)]
    assert all(split_key(key)[0] in measures for of in sizes for key in of)
    assert {"signal_to_noise", "correlated_errors"} <= {effect["type"] for effect in typical("radar", measures)}
    assert typical("radar", ALL) == [
        effect.model_dump(exclude_unset=True) for effect in Radar(**options(ALL, effects="typical")).effects
    ]


@every_subset
def test_density_times_volume_is_the_number_of_false_alarms(measures: tuple[str, ...]) -> None:
    """Poisson counts of 400 scans in the whole view, and in a box within it: the box tells the density by itself."""
    clutter = {"per_scan": 8, **({"range_rate_mps": [-20.0, 40.0]} if "range_rate" in measures else {})}
    config = Radar(**options(measures, max_range_m=120, fov_deg=80, clutter=clutter))
    time = np.arange(400) / 10
    nothing = np.full((400, 1, 1), 1e4)
    scene = truth(time, nothing, nothing, nothing * 0, nothing * 0, observer=fixed_observer(400))
    hidden = sense_hidden(ideal_sensors(scene, {"radar": config}), 3, "clutter", range(1))
    assert all((origins[:, 0] == FALSE_ALARM).all() for origins in hidden.origins)
    seen = np.concatenate([scan.measurement[..., 0] for scan in hidden.scans], axis=1)
    boxes = {"range": (30.0, 70.0), "azimuth": (-0.2, 0.5), "range_rate": (0.0, 30.0)}
    box = [boxes[name] for name in measures]
    inside = np.all([(low < row) & (row < high) for row, (low, high) in zip(seen, box, strict=True)], axis=0)
    density = stated_detection(config)[1]
    assert hidden.scans[0].clutter_density == density
    for count, volume in ((seen.shape[1], config.volume()), (inside.sum(), np.prod([b - a for a, b in box]))):
        expected = len(time) * density * volume
        assert abs(count - expected) < 4 * np.sqrt(expected)


@pytest.mark.slow
@every_subset
def test_new_objects_have_the_density_of_objects_uniform_in_view(measures: tuple[str, ...]) -> None:
    """At half of the range and at the mean velocity, where the density is that of one object over the volume."""
    random, count, velocity_sigma, view = np.random.default_rng(0), 4_000_000, 8.0, FieldOfView(0.7, 100.0)
    r, azimuth = 100 * np.sqrt(random.random(count)), random.uniform(-0.7, 0.7, count)
    place = np.stack([r * np.cos(azimuth), r * np.sin(azimuth)])
    target = np.concatenate([place, velocity_sigma * random.standard_normal((2, count))])
    model = SENSOR_MODELS[kind(measures)]
    seen = model.measure(target, np.zeros(3), np.zeros(2))
    centre, half = {"range": 50.0, "azimuth": 0.0, "range_rate": 0.0}, {"range": 3.0, "azimuth": 0.1, "range_rate": 0.8}
    near = np.all([abs(row - centre[n]) < half[n] for row, n in zip(seen, measures, strict=True)], axis=0)
    expected = count * np.prod([2 * half[name] for name in measures]) / volumes(kind(measures), view, velocity_sigma)[0]
    assert near.sum() == pytest.approx(expected, rel=4 / np.sqrt(expected) + 0.003)


@pytest.mark.parametrize(
    ("measures", "message"),
    [
        (["range", "azimut"], "'azimut' is not known; did you mean 'azimuth'?"),
        (["range", "range"], "range is named twice; remove one"),
        ([], "must not be empty"),
        ("range", "a list is needed, not 'range'"),
        (["range", 3], "must be a word, not 3; choose from: range, azimuth, range_rate"),
        ([["range"]], "must be a word, not a list; choose from: range, azimuth, range_rate"),
        (None, "a list is needed, not nothing"),
    ],
)
def test_what_cannot_be_measured_is_refused(measures: Any, message: str) -> None:
    given = {"type": "radar", **options(ALL), "measures": measures}
    with pytest.raises(ValidationError) as caught:
        Radar.model_validate(
            {key: value for key, value in given.items() if measures != ["range", "range"] or "az" not in key}
        )
    assert message in str(caught.value)


def test_clutter_of_a_range_rate_that_is_not_measured_is_refused() -> None:
    with pytest.raises(ValidationError, match="which does not have it; remove this"):
        Radar(**options(("range", "azimuth"), max_range_m=50, clutter={"per_scan": 1, "range_rate_mps": [-5.0, 5.0]}))
