"""The typical effects of a radar beside one minute of a real one: results/radar/radar.md.

Run as ``python -m benchmarks.radar``; TRACKBENCH_DATA has the recording. Residuals are those from a parabola over a
second around each instant, which takes out the motion of the cars and what of the error is slower. Innovations are
those from a parabola over the second before, as of a filter of fixed memory.

Sources: Morrison (1969), "Introduction to Sequential Smoothing and Prediction", chapter 7, for that filter; Blackman
and Tukey (1958), "The Measurement of Power Spectra", for spectra from autocorrelations, here with Parzen's lag window.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import trackbench as tb
from trackbench.base.types import Array
from trackbench.models.sensors.presets import typical

OUT = Path(__file__).parents[1] / "results" / "radar" / "radar.md"
COMPONENTS = ("forward", "left", "relative speed")
#: Windows of a parabola before and after an instant, s.
AROUND, BEFORE = (-0.5, 0.5), (-1.0, -0.025)
#: Measurements in a window, at the least: a half of them.
FEWEST = 10
PERIOD_S = 0.05
#: Autocorrelations that are made, and shown.
LAGS, SHOWN_LAGS = 20, (1, 2, 3, 5, 10)
FREQUENCIES_HZ = (1, 2, 3, 4, 6, 8, 10)
#: Lags to which the time constant is fitted, and where the recording is parted for that, s.
FITTED_LAGS, HALF_S = slice(1, 11), 30.0
TIME_CONSTANTS_S = np.geomspace(0.03, 10, 60)
#: Objects are drawn again so many times for an interval of 95 %.
REPEATS = 1000
#: Ranges in m between which the growth of the residuals is taken.
NEAR, FAR = (30.0, 60.0), (100.0, 185.0)
#: Instants of a segment, at the least.
SHORTEST = 60
SEEDS = [3, 5, 8, 13, 21, 34]
SIGMAS = {"range_sigma_m": 0.15, "azimuth_sigma_deg": 0.1, "range_rate_sigma_mps": 0.08}
EXACT = {"range_sigma_m": 1e-6, "azimuth_sigma_deg": 1e-7, "range_rate_sigma_mps": 1e-6}


class Segment(NamedTuple):
    """One object while it is measured without a pause."""

    time: Array
    values: Array
    """``(3, instants)`` forward and left m, relative speed m/s."""
    errors: Array
    """``(3, instants)`` the same without the motion, where it is known."""


def recorded(file: Path) -> list[Segment]:
    """The segments of the recording: of one slot, from one new object to the next."""
    columns = np.genfromtxt(file, delimiter=",", names=True)
    segments = []
    for slot in np.unique(columns["slot"]):
        rows = columns[columns["slot"] == slot]
        values = np.stack([rows["forward_m"], rows["left_m"], rows["relative_speed_mps"]])
        segments += cut(rows["time_s"], values, rows["new_track"] == 1)
    return segments


def simulated(effects: Any) -> list[Segment]:
    """The errors of a radar at 20 Hz that sees the cars around the ego of highway-env: their motion is known."""
    segments = []
    for seed in SEEDS:
        noisy = readings({**SIGMAS, "effects": effects}, seed)
        exact = readings(EXACT, seed)
        for i in range(len(noisy.valid[0])):
            seen = noisy.valid[:, i]
            values, true = (forward_left(of.measurement[:, :, i][:, seen]) for of in (noisy, exact))
            segments += cut(noisy.time[seen], values, np.zeros(seen.sum(), dtype=bool), values - true)
    return segments


class Readings(NamedTuple):
    """Of one scene."""

    time: Array
    valid: Array
    """``(instants, objects)``."""
    measurement: Array
    """``(3, instants, objects)``."""


def readings(keys: dict[str, Any], seed: int) -> Readings:
    """What a radar with these keys measures."""
    truth = {
        "source": "highway-env",
        "env": "highway-v0",
        "config": {"vehicles_count": 20},
        "seed": seed,
        "duration_s": 20,
        "rate_hz": 20,
        "targets": "all",
    }
    radar = {"type": "radar", "rate_hz": 20, "fov_deg": 60, "max_range_m": 185, **keys}
    scans = tb.sense(
        {
            "name": "radar",
            "truth": truth,
            "sensors": {"radar": radar},
            "trackers": {"raw": {"use": "raw"}},
            "monte_carlo": {"runs": 1, "seed": 1},
        }
    )
    return Readings(
        np.array([scan.time for scan in scans]),
        np.stack([scan.valid[:, 0] for scan in scans]),
        np.stack([scan.measurement[..., 0] for scan in scans], axis=1),
    )


def forward_left(measured: Array) -> Array:
    """Forward and left m and relative speed m/s from range, azimuth and range rate."""
    distance, azimuth, speed = measured
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), speed])


def cut(time: Array, values: Array, first: Array, errors: Array | None = None) -> Iterator[Segment]:
    """The parts between pauses of half a second and new objects that are long enough."""
    ends = np.flatnonzero((np.diff(time) > 0.5) | first[1:]) + 1
    for part in np.split(np.arange(len(time)), ends):
        if len(part) >= SHORTEST:
            yield Segment(time[part], values[:, part], (values if errors is None else errors)[:, part])


def deviations(segment: Segment, window: tuple[float, float]) -> Array:
    """``(3, instants)`` from a parabola through the measurements of a window around each; NaN where the window reaches
    beyond an end or has too few."""
    result = np.full(segment.values.shape, np.nan)
    time, (begin, end) = segment.time, window
    for i in np.flatnonzero((time - time[0] >= -begin) & (time[-1] - time >= end)):
        near = (time >= time[i] + begin) & (time <= time[i] + end)
        if near.sum() >= FEWEST:
            powers = np.vander(time[near] - time[i], 3)
            weights = np.linalg.lstsq(powers, segment.errors[:, near].T, rcond=None)[0]
            result[:, i] = segment.errors[:, i] - weights[-1]
    return result


def lagged(segments: list[Segment]) -> Array:
    """``(2, 3, objects, LAGS + 1)`` sums of products of innovations so many cycles apart, and their numbers."""
    result = np.zeros((2, 3, len(segments), LAGS + 1))
    for number, segment in enumerate(segments):
        steps = np.diff(segment.time)
        cycle = np.concatenate([[0], np.cumsum(np.rint(steps / np.median(steps)))]).astype(int)
        part = np.full((3, cycle[-1] + 1), np.nan)
        part[:, cycle] = deviations(segment, BEFORE)
        for lag in range(LAGS + 1):
            products = part[:, lag:] * part[:, : part.shape[1] - lag]
            result[:, :, number, lag] = np.nansum(products, axis=1), np.isfinite(products).sum(axis=1)
    return result


def autocorrelations(sums: Array) -> Array:
    """``(3, LAGS + 1, 1 + REPEATS)`` of all objects, then of as many drawn from them with replacement."""
    objects = sums.shape[2]
    draws = np.random.default_rng(1).integers(objects, size=(REPEATS, objects))
    chosen = np.concatenate([sums.sum(axis=2)[..., None], np.moveaxis(sums[:, :, draws].sum(axis=3), 2, -1)], axis=-1)
    covariance = chosen[0] / np.maximum(chosen[1], 1)
    return np.asarray(covariance / covariance[:, :1])


def spectra(correlation: Array) -> Array:
    """``(3, frequencies, ...)`` power spectral densities over that of white noise of the same variance."""
    lag = np.arange(LAGS + 1)
    share = lag / LAGS
    parzen = np.where(share <= 0.5, 1 - 6 * share**2 * (1 - share), 2 * (1 - share) ** 3)
    waves = np.cos(2 * np.pi * np.outer(FREQUENCIES_HZ, lag) * PERIOD_S) * parzen * np.where(lag == 0, 1, 2)
    return np.einsum("fl,cl...->cf...", waves, correlation)


def with_interval(values: Array) -> str:
    """A value, and the interval over those of objects drawn again, which come after it."""
    low, high = np.quantile(values[1:], [0.025, 0.975])
    return f"{values[0]:.2f} ({low:.2f} to {high:.2f})"


def innovations_of(time_s: float) -> Array:
    """``(LAGS + 1,)`` autocorrelation of the innovations of a Gauss-Markov process that is measured in every cycle."""
    past = -np.arange(1, round(-BEFORE[0] / PERIOD_S) + 1) * PERIOD_S
    response = np.concatenate([[1.0], -np.linalg.pinv(np.vander(past, 3))[-1]])
    far = LAGS + len(response)
    process = np.exp(-np.abs(np.arange(-far, far + 1)) * PERIOD_S / time_s)
    result = np.convolve(process, np.correlate(response, response, "full"), "same")[far : far + LAGS + 1]
    return np.asarray(result / result[0])


def time_constants(sums: Array) -> Array:
    """``(1 + REPEATS,)`` s, one for all components, that is nearest to the first autocorrelations of innovations."""
    of_models = np.stack([innovations_of(time_s)[FITTED_LAGS] for time_s in TIME_CONSTANTS_S])
    off = autocorrelations(sums)[:, None, FITTED_LAGS] - of_models[None, ..., None]
    return np.asarray(TIME_CONSTANTS_S[np.argmin((off**2).sum(axis=(0, 2)), axis=0)])


def figures(segments: list[Segment]) -> dict[str, list[str]]:
    """By component: the size of the residuals, their growth with range, their correlation far away, and the step of the
    values."""
    parts = [deviations(segment, AROUND) for segment in segments]
    following = [
        np.where(np.diff(segment.time) < 1.5 * PERIOD_S, part[:, 1:] * part[:, :-1], np.nan)
        for segment, part in zip(segments, parts, strict=True)
    ]
    forward = np.concatenate([segment.values[0] for segment in segments])
    first = np.concatenate([segment.values[0, :-1] for segment in segments])
    table = {}
    for k, name in enumerate(COMPONENTS):
        every = np.concatenate([part[k] for part in parts])
        products = np.concatenate([part[k] for part in following])
        near, far = (every[(forward >= low) & (forward < high)] for low, high in (NEAR, FAR))
        growth = np.nanmedian(np.abs(far)) / np.nanmedian(np.abs(near))
        correlation = np.nanmean(products[(first >= FAR[0]) & (first < FAR[1])]) / np.nanmean(far**2)
        values = np.unique(np.round(np.concatenate([segment.values[k] for segment in segments]), 6))
        step = np.min(np.diff(values)) if len(values) < len(forward) / 2 else 0.0
        cells = [f"{np.sqrt(np.nanmean(every**2)):.3f}", f"{growth:.2f}", f"{correlation:.2f}"]
        table[name] = [*cells, f"{step:.3f}" if step > 0.002 else "none"]
    return table


def parted(segments: list[Segment]) -> list[list[Segment]]:
    """What is before and after ``HALF_S``, where it is long enough."""
    sides = [[(of, of.time < HALF_S) for of in segments], [(of, of.time >= HALF_S) for of in segments]]
    return [
        [Segment(of.time[side], of.values[:, side], of.errors[:, side]) for of, side in half if side.sum() >= SHORTEST]
        for half in sides
    ]


def table_of(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def gaps(segments: list[Segment]) -> float:
    """Share of the intervals between measurements that are longer than one and a half periods."""
    steps = [np.diff(segment.time) for segment in segments]
    return float(np.mean(np.concatenate(steps) > 1.5 * np.median(np.concatenate(steps))))


def by_component(columns: list[str], radars: dict[str, Array], model: Array) -> str:
    """A table of ``(3, columns, 1 + REPEATS)`` of each radar, and of the same of a model, ``(columns,)``."""
    rows = [
        [component, name, *map(with_interval, of[k])]
        for k, component in enumerate(COMPONENTS)
        for name, of in radars.items()
    ]
    return table_of(["component", "radar", *columns], [*rows, ["each", "model", *(f"{value:.2f}" for value in model)]])


def main() -> None:
    data = Path(os.environ["TRACKBENCH_DATA"]) / "comma2k19" / "radar.csv"
    effects = typical("radar")
    constant = [{**of, "constant_share": 1} if of["type"] == "signal_to_noise" else of for of in effects]
    radars = {
        "real": recorded(data),
        "typical": simulated("typical"),
        "typical, constant noise": simulated(constant),
        "ideal": simulated("ideal"),
    }
    of_radar = {name: figures(segments) for name, segments in radars.items()}
    innovations = {name: autocorrelations(lagged(segments)) for name, segments in radars.items()}
    text = INTRODUCTION + table_of(
        ["component", "radar", "std", "far / near", f"far, {PERIOD_S:.2f} s", "step"],
        [[name, radar, *of_radar[radar][name]] for name in COMPONENTS for radar in radars],
    )
    for name, segments in radars.items():
        count = sum(len(segment.time) for segment in segments)
        late = f"{100 * gaps(segments):.2f} % of the intervals are longer than 1.5 periods"
        text += f"- {name}: {count:,} measurements of {len(segments)} objects; {late}.\n"
    sums = [lagged(half) for half in parted(radars["real"])]
    fits = [time_constants(half) for half in sums]
    model = innovations_of(fits[0][0])
    text += INNOVATIONS + by_component(
        [f"{lag * PERIOD_S:.2f} s" for lag in SHOWN_LAGS],
        {name: of[:, list(SHOWN_LAGS)] for name, of in innovations.items()},
        model[list(SHOWN_LAGS)],
    )
    text += SPECTRA + by_component(
        [f"{frequency} Hz" for frequency in FREQUENCIES_HZ],
        {name: spectra(of) for name, of in innovations.items()},
        spectra(model[None])[0],
    )
    first = [autocorrelations(half)[:, 1] for half in sums]
    (of_typical,) = (of["time_s"] for of in effects if of["type"] == "correlated_errors")
    models = {"model of the first half": fits[0][0], "typical, slow errors alone": of_typical}
    text += TIME_CONSTANT + table_of(
        ["", "time constant, s", *(f"{name}, {PERIOD_S:.2f} s" for name in COMPONENTS)],
        [
            *(
                [name, *map(with_interval, [fit, *of_half])]
                for name, fit, of_half in zip(("first half", "second half, held back"), fits, first, strict=True)
            ),
            *(
                [name, f"{value:.2f}", *[f"{innovations_of(value)[1]:.2f}"] * len(COMPONENTS)]
                for name, value in models.items()
            ),
        ],
    )
    text += CONCLUSION
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(text, encoding="utf-8")
    print(text)


INTRODUCTION = """\
# A typical radar beside a real one

Made by `make radar`. Real: one minute of the radar of a production car (comma2k19). Typical and ideal: cars of
highway-env seen by a radar with the [typical effects](../../docs/sensor-effects.md) and with none. With "constant
noise" the noise of the typical radar does not follow the signal: `constant_share: 1` of `signal_to_noise`.

The residuals are those from a parabola over one second, of the simulated radars without the motion of the cars. The
table has their standard deviation in m and m/s, and their median size at 100 to 185 m over that at 30 to 60 m. Then it
has their autocorrelation over one cycle at 100 to 185 m, and the step of the values. The simulated standard deviations
are options of the sensor: they are not compared.

"""

INNOVATIONS = """
## Innovations

The innovations are what a measurement differs by from a parabola through the second before it, as of a filter of fixed
memory, the same for all radars. Those of the real one hold the motion of the cars too. Their autocorrelation follows,
with intervals of 95 % over objects (drawn again 1,000 times). The model is the first-order Gauss-Markov process of the
first half of the recording, [below](#the-time-constant-of-slow-errors).

"""

SPECTRA = """\
Their power spectral density over that of white noise of the same variance (Blackman and Tukey, with a lag window of
Parzen over one second):

"""

TIME_CONSTANT = """\
## The time constant of slow errors

One first-order Gauss-Markov process for all components is fitted to the first 30 s of the recording, by the
autocorrelations of the innovations at 0.05 to 0.5 s. The rest is held back. Beside the time constants are the
autocorrelations over one cycle:

"""

CONCLUSION = """\
What differs:

- The real radar gives a list of objects that its maker has filtered. Its sideways innovations have less power from 6 Hz
  on than those of the model, and its errors are correlated far away too.
- The typical radar has more power from 6 Hz on. Its noise follows a signal that is drawn anew for each scan, which is
  white, and grows with range. With constant noise it comes nearer, but its errors along no longer grow with range.
- Both halves of the recording fit a shorter time constant than the typical one, which stands for slower errors too:
  those of more than a second cannot be told from the motion of cars there.
- The real radar bridges missed detections, so that there are none within an object. The typical one misses what the
  signal misses.
- The sideways error of the real radar hardly grows with range. The typical one's grows as an error of the azimuth does.
- Where on a car the reflection is cannot be seen in the recording.
"""

if __name__ == "__main__":
    main()
