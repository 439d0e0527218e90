"""The typical effects of a radar beside one minute of a real one: results/radar/radar.md.

Run as ``python -m benchmarks.radar``; TRACKBENCH_DATA has the recording. Residuals are those from a parabola over a
second around each instant, which takes out the motion of the cars and what of the error is slower.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import trackbench as tb
from trackbench.base.types import Array

OUT = Path(__file__).parents[1] / "results" / "radar" / "radar.md"
COMPONENTS = ("forward", "left", "relative speed")
WINDOW_S = 1.0
LAGS = (1, 2, 3, 5, 10)
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


def residuals(segment: Segment) -> Array:
    """``(3, instants)`` from a parabola over a second; NaN within half a second of an end."""
    result = np.full(segment.values.shape, np.nan)
    time, half = segment.time, WINDOW_S / 2
    for i in np.flatnonzero((time - time[0] >= half) & (time[-1] - time >= half)):
        near = np.abs(time - time[i]) <= half
        powers = np.vander(time[near] - time[i], 3)
        weights = np.linalg.lstsq(powers, segment.errors[:, near].T, rcond=None)[0]
        result[:, i] = segment.errors[:, i] - weights[-1]
    return result


def figures(segments: list[Segment]) -> dict[str, list[str]]:
    """By component: the autocorrelation of the residuals, their growth with range, and the step of the values."""
    parts = [residuals(segment) for segment in segments]
    table = {}
    for k, name in enumerate(COMPONENTS):
        every = np.concatenate([part[k] for part in parts])
        power = np.nanmean(every**2)
        lagged = [np.concatenate([part[k, lag:] * part[k, :-lag] for part in parts]) for lag in LAGS]
        forward = np.concatenate([segment.values[0] for segment in segments])
        spread = [np.nanmedian(np.abs(every[(forward >= low) & (forward < high)])) for low, high in (NEAR, FAR)]
        values = np.unique(np.round(np.concatenate([segment.values[k] for segment in segments]), 6))
        step = np.min(np.diff(values)) if len(values) < len(forward) / 2 else 0.0
        cells = [f"{np.sqrt(power):.3f}", *(f"{np.nanmean(values) / power:.2f}" for values in lagged)]
        table[name] = [*cells, f"{spread[1] / spread[0]:.2f}", f"{step:.3f}" if step > 0.002 else "none"]
    return table


def gaps(segments: list[Segment]) -> float:
    """Share of the intervals between measurements that are longer than one and a half periods."""
    steps = [np.diff(segment.time) for segment in segments]
    return float(np.mean(np.concatenate(steps) > 1.5 * np.median(np.concatenate(steps))))


def main() -> None:
    data = Path(os.environ["TRACKBENCH_DATA"]) / "comma2k19" / "radar.csv"
    worlds = {"real": recorded(data), "typical": simulated("typical"), "ideal": simulated("ideal")}
    header = ["component", "radar", "std", *(f"lag {lag}" for lag in LAGS), "far / near", "step"]
    lines = [" | ".join(header), " | ".join(["---"] * len(header))]
    tables = {name: figures(segments) for name, segments in worlds.items()}
    for component in COMPONENTS:
        lines += [" | ".join([component, name, *tables[name][component]]) for name in worlds]
    text = INTRODUCTION + "".join(f"| {line} |\n" for line in lines) + "\n"
    for name, segments in worlds.items():
        count = sum(len(segment.time) for segment in segments)
        late = f"{100 * gaps(segments):.2f} % of the intervals are longer than 1.5 periods"
        text += f"- {name}: {count:,} measurements of {len(segments)} objects; {late}.\n"
    text += CONCLUSION
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(text, encoding="utf-8")
    print(text)


INTRODUCTION = """\
# A typical radar beside a real one

Made by `make radar`. Real: one minute of the radar of a production car (comma2k19). Typical and ideal: cars of
highway-env seen by a radar with the [typical effects](../../docs/sensor-effects.md) and with none.

The residuals are those from a parabola over one second, of the simulated radars without the motion of the cars. The
table has their standard deviation in m and m/s, their autocorrelation at lags of 20 Hz, and their median size at 100 to
185 m over that at 30 to 60 m. The simulated standard deviations are options of the sensor: they are not compared.

"""

CONCLUSION = """
The real radar gives a list of objects that its maker has filtered, which the model is not:

- It bridges missed detections, so that there are none within an object. The model misses those that the signal misses.
- Its sideways error hardly grows with range. The model's grows as an error of the azimuth does.
- Where on a car the reflection is, and any error that is slower than a second, cannot be seen in it.
"""

if __name__ == "__main__":
    main()
