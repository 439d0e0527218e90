"""The radar's page: its spectra and its time constant, of errors that are known."""

import numpy as np
import pytest

from benchmarks import radar
from trackbench.models.sensors.effects import gauss_markov


def objects_of(errors):
    """An object of 12 s at 20 Hz for each column, which brakes evenly."""
    time = np.arange(len(errors)) * radar.PERIOD_S
    kept = (time % 10 < 9) | (np.arange(len(time)) % 3 == 0)
    motion = 20 + 3 * time - 0.5 * time**2
    return [
        radar.Segment(time[kept], np.tile(values[kept], (3, 1)), np.tile((values + motion)[kept], (3, 1)))
        for values in errors.T
    ]


@pytest.fixture(scope="module")
def slow():
    """The innovations of errors with a time constant of 0.3 s."""
    time = np.arange(240) * radar.PERIOD_S
    return radar.lagged(objects_of(gauss_markov(time, 0.3, np.random.default_rng(1).standard_normal((240, 30)))))


def test_the_time_constant_of_a_process_is_found(slow):
    found = radar.time_constants(slow)
    low, high = np.quantile(found[1:], [0.005, 0.995])
    assert low < 0.3 < high
    assert high < 0.6


def test_the_innovations_of_a_process_have_the_autocorrelation_of_the_formula(slow):
    of = radar.autocorrelations(slow)[0]
    spread = of[1:, 1:].std(axis=-1)
    assert (np.abs(of[1:, 0] - radar.innovations_of(0.3)[1:]) < 4.5 * spread).all()


def test_spectra_are_the_sums_of_cosines_of_textbooks():
    white = np.zeros((3, radar.LAGS + 1))
    white[:, 0] = 1
    np.testing.assert_allclose(radar.spectra(white), 1)
    # A cosine of 4 Hz has its power there.
    lag = np.arange(radar.LAGS + 1) * radar.PERIOD_S
    density = radar.spectra(np.cos(2 * np.pi * 4 * lag)[None])[0]
    assert radar.FREQUENCIES_HZ[np.argmax(density)] == 4
    # No density is negative: the transform of the window is not.
    assert density.min() > -1e-12


def test_a_recording_is_parted_in_time():
    time = np.arange(1200) * radar.PERIOD_S
    values = np.zeros((3, 1200))
    first, second = radar.parted([radar.Segment(time, values, values)])
    assert first[0].time[-1] < radar.HALF_S <= second[0].time[0]
    assert len(first[0].time) + len(second[0].time) == 1200
