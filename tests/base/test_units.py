"""Angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackbench.base.units import cos_sin, difference, wrap_angle

ANGLES = st.one_of(st.floats(-1e4, 1e4), st.integers(-999, 999).map(lambda k: k * np.pi))


@given(ANGLES)
def test_wrapped_angle_is_in_half_open_range_and_points_the_same_way(angle):
    wrapped = wrap_angle(np.array(angle))
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-11)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-11)


@given(st.floats(-3.1, 3.1), st.integers(-1000, 1000))
def test_wrap_has_the_period_of_a_full_turn(angle, turns):
    assert wrap_angle(np.array(angle + turns * 2 * np.pi)) == pytest.approx(angle, abs=1e-11)


@given(st.floats(-3.14159, np.pi))
def test_wrap_leaves_a_wrapped_angle_as_it_is(angle):
    assert wrap_angle(np.array(angle)) == angle


def test_wrap_at_the_ends_of_its_range():
    ends = np.array(
        [-np.pi, np.pi, 3 * np.pi, -3 * np.pi, *np.nextafter([np.pi, np.pi, -np.pi, -np.pi], [4, 0, -4, 0])]
    )
    np.testing.assert_allclose(np.abs(wrap_angle(ends)), np.pi, rtol=1e-15)
    assert wrap_angle(ends[0]) == np.pi
    assert np.all((wrap_angle(ends) > -np.pi) & (wrap_angle(ends) <= np.pi))
    assert np.isnan(wrap_angle(np.array(np.nan)))


@given(ANGLES)
def test_cosine_and_sine_agree_with_numpy(angle):
    c, s = cos_sin(np.array(angle))
    assert c == pytest.approx(np.cos(angle), abs=1e-15)
    assert s == pytest.approx(np.sin(angle), abs=1e-15)


def test_cosine_and_sine_at_the_quarters():
    quarters = np.arange(-8, 9) * np.pi / 2
    np.testing.assert_allclose(cos_sin(quarters), [np.cos(quarters), np.sin(quarters)], atol=1e-15)


def test_difference_wraps_only_the_angular_components():
    a, b = np.array([[5.0], [3.0], [0.0]]), np.array([[-5.0], [-3.0], [1.0]])
    np.testing.assert_allclose(difference(a, b, (1,)), [[10.0], [6.0 - 2 * np.pi], [-1.0]])
    np.testing.assert_allclose(difference(a, b, ()), [[10.0], [6.0], [-1.0]])
