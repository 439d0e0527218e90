"""The colours of trackers and sensors are distinct, also to a colour-blind reader, on a dark and on a white ground."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from trackbench.base.types import Array
from trackbench.document.palette import (
    IDENTITY_COLOURS,
    SENSOR_COLOURS,
    TRACKER_COLOURS,
)

# Linear sRGB to cone responses and to OKLab: Ottosson, "A perceptual color space for image processing", 2020.
CONES = np.array(
    [
        [0.41222147, 0.53633254, 0.05144599],
        [0.21190350, 0.68069955, 0.10739696],
        [0.08830246, 0.28171884, 0.62997870],
    ]
)
LAB = np.array(
    [
        [0.21045426, 0.79361779, -0.00407205],
        [1.97799850, -2.42859221, 0.45059371],
        [0.02590404, 0.78277177, -0.80867577],
    ]
)
# Machado, Oliveira and Fernandes, IEEE Trans. Visualization and Computer Graphics 15(6), 2009, severity 1.
PROTANOPIA = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
)
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
#: Twice the just noticeable difference in OKLab, which is about 0.02, and a little more.
APART = 0.045


def linear(colour: str) -> Array:
    channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


def difference(a: str, b: str) -> float:
    """The smallest in OKLab over normal sight, protanopia and deuteranopia."""
    seen = [
        [LAB @ np.cbrt(CONES @ np.clip(eye @ linear(colour), 0, 1)) for colour in (a, b)]
        for eye in (np.eye(3), PROTANOPIA, DEUTERANOPIA)
    ]
    return min(float(np.linalg.norm(first - second)) for first, second in seen)


def contrast(colour: str, ground: str) -> float:
    """WCAG 2."""
    low, high = sorted(linear(each) @ (0.2126, 0.7152, 0.0722) + 0.05 for each in (colour, ground))
    return float(high / low)


@pytest.mark.parametrize("colours", [TRACKER_COLOURS, SENSOR_COLOURS, IDENTITY_COLOURS])
def test_colours_are_told_apart(colours: tuple[str, ...]) -> None:
    assert min(difference(a, b) for a, b in combinations(colours, 2)) > APART


@pytest.mark.parametrize("colour", TRACKER_COLOURS)
def test_colours_are_seen_on_both_grounds(colour: str) -> None:
    assert contrast(colour, "#101216") > 2.5
    assert contrast(colour, "#FFFFFF") > 2.0


@pytest.mark.parametrize("colour", IDENTITY_COLOURS)
def test_identities_are_no_tracker_or_sensor(colour: str) -> None:
    assert min(difference(colour, other) for other in (*TRACKER_COLOURS, *SENSOR_COLOURS)) > 0.06
    assert contrast(colour, "#101216") > 9
