"""Measures a real radar and a simulated one alike, and writes the tables of comma2k19.md.

``TRACKBENCH_DATA=... python docs/projects/comma2k19.py`` from the repository's folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from tables import fill, markdown

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.base.units import cos_sin
from trackbench.models.sensors import Radar
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import Measurements, ideal_sensors
from trackbench.trackers.builtin import ekf

HERE = Path(__file__).resolve().parent
REAL = HERE.parent.parent / "scenarios" / "recorded" / "comma2k19.yaml"
SIMULATED = HERE / "comma2k19_simulated.yaml"
#: Scans in a row without a detection after which a track is another one: 1 s, as where a slot is read.
LONGEST_GAP = 20
#: Of each track these many scans settle the filter; only tracks with as many more tell of the innovations.
SETTLING = 40
#: Half of the time over which a distance's slope is taken, scans.
HALF_WINDOW = 10


class AlongRoad(Radar):
    """A radar whose third component is the relative speed along its own axis, and not along the line of sight."""

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        polar = Radar.measure(target, pose, velocity)
        c, s = cos_sin(pose[2])
        along = c * (target[2] - velocity[0]) + s * (target[3] - velocity[1])
        return linalg.vector([polar[0], polar[1], along])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        slope = Radar.jacobian(target, pose, velocity)
        c, s = cos_sin(pose[2])
        zero = np.zeros_like(target[0])
        return linalg.matrix([[*slope[0]], [*slope[1]], [zero, zero, zero + c, zero + s]])


class TrackLog(NamedTuple):
    """The detections of one of the sensor's own tracks, or of a simulated object, without longer gaps."""

    number: Array
    """``(n,)`` of their scans."""
    scans: list[Scan]
    """Of one object each: ``measurement`` ``(3, 1)``."""


class Innovations(NamedTuple):
    """Of a filter on each track alone, ``(3, n)`` range m, azimuth rad, range rate m/s, and what follows each."""

    value: Array
    next: Array
    log_likelihood: Array
    """``(n,)``"""
    nis: Array
    """``(n,)``"""


class RateSlopes(NamedTuple):
    """At the middle of each window, ``(n,)`` m/s; ``track`` says of which track."""

    range_rate: Array
    """Slope of the range."""
    forward_rate: Array
    """Slope of the distance along the road."""
    stated: Array
    """Mean of what the sensor says."""
    track: Array


def sensed(path: Path) -> tuple[Scenario, Measurements]:
    """The scans of the first run of a scenario."""
    loaded = load_scenario(path)
    truth = truths_of(loaded)[0]
    sensors = ideal_sensors(truth.truth, loaded.config.sensors, truth.measurements)
    return loaded, sense_hidden(sensors, loaded.config.monte_carlo.seed, loaded.config.name, range(1))


def track_logs(found: Measurements) -> list[TrackLog]:
    """The detections by what caused them; false alarms are left out."""
    rows: dict[int, list[tuple[int, Scan]]] = {}
    for number, (scan, origins) in enumerate(zip(found.scans, found.origins, strict=True)):
        for column in np.flatnonzero(origins[:, 0] >= 0).tolist():
            one = scan._replace(measurement=scan.measurement[:, column], valid=scan.valid[column])
            rows.setdefault(int(origins[column, 0]), []).append((number, one))
    logs = []
    for own in rows.values():
        numbers = np.array([number for number, _ in own])
        for part in np.split(np.arange(len(own)), np.flatnonzero(np.diff(numbers) > LONGEST_GAP) + 1):
            logs.append(TrackLog(numbers[part], [own[i][1] for i in part]))
    return logs


def innovations(logs: list[TrackLog], kind: str = "radar", acceleration: float = 2.0) -> Innovations:
    """Those of an EKF of constant velocity."""
    parts = []
    for log in logs:
        if len(log.scans) < 2 * SETTLING:
            continue
        tracker = ekf(motion="cv", acceleration_sigma_mps2=acceleration, initial="first_measurement")
        state, found = None, []
        for scan in log.scans:
            state, answer = tracker.step(state, scan._replace(kind=kind))
            found.append((answer.innovation[:, 0], answer.innovation_covariance[..., 0]))
        value = np.array([innovation for innovation, _ in found[SETTLING:]]).T
        covariance = np.array([s for _, s in found[SETTLING:]])
        nis = np.einsum("in,nij,jn->n", value, np.linalg.inv(covariance), value)
        log_likelihood = -0.5 * (nis + np.linalg.slogdet(2 * np.pi * covariance)[1])
        parts.append((value[:, :-1], value[:, 1:], log_likelihood[:-1], nis[:-1]))
    return Innovations(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))


def autocorrelation(found: Innovations) -> Array:
    """``(3,)`` of each component with that of the next scan."""
    return (found.value * found.next).mean(axis=1) / (found.value**2).mean(axis=1)


def rate_slopes(logs: list[TrackLog]) -> RateSlopes:
    """How range and distance ahead change over about 1 s, and the mean of what the sensor says of the same time."""
    parts, h = [], HALF_WINDOW
    for number, log in enumerate(logs):
        # Each track in pieces without a gap.
        for piece in np.split(np.arange(len(log.number)), np.flatnonzero(np.diff(log.number) > 1) + 1):
            if len(piece) <= 2 * h:
                continue
            time = np.array([log.scans[i].time for i in piece])
            r, azimuth, rate = np.array([log.scans[i].measurement[:, 0] for i in piece]).T
            elapsed = time[2 * h :] - time[: -2 * h]
            whole = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
            slopes = [(of[2 * h :] - of[: -2 * h]) / elapsed for of in (r, r * np.cos(azimuth), whole)]
            parts.append((*slopes, np.full(len(elapsed), float(number))))
    return RateSlopes(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def share_along_sight(slopes: RateSlopes) -> tuple[float, float]:
    """Least squares share of the line of sight in what the sensor says, and its standard error by tracks."""
    apart, stated = slopes.range_rate - slopes.forward_rate, slopes.stated - slopes.forward_rate
    share = float(apart @ stated / (apart @ apart))
    of_track = np.bincount(slopes.track.astype(int), apart * (stated - share * apart))
    return share, float(np.sqrt((of_track**2).sum()) / (apart @ apart))


def doppler_table(logs: list[TrackLog]) -> str:
    slopes = rate_slopes(logs)
    apart = np.abs(slopes.range_rate - slopes.forward_rate)
    rows = []
    for what, kind, rate in (
        ("line of sight", "radar", slopes.range_rate),
        ("road", "comma2k19:AlongRoad", slopes.forward_rate),
    ):
        found = innovations(logs, kind)
        errors = slopes.stated - rate
        rms = [f"{np.sqrt(np.mean(errors[apart > least] ** 2)):.3f}" for least in (0.0, 0.1, 0.3)]
        rows.append(
            (
                what,
                *rms,
                f"{found.value[2].std():.4f}",
                f"{autocorrelation(found)[2]:.3f}",
                f"{found.log_likelihood.mean():.4f}",
            )
        )
    head = (
        "the column is the speed along the",
        "slope minus it, RMS m/s",
        "where the two differ by 0.1 m/s",
        "by 0.3 m/s",
        "EKF: innovation, m/s",
        "its correlation with the next",
        "log-likelihood a detection",
    )
    return markdown(head, rows)


def statistics(loaded: Scenario, found: Measurements) -> dict[str, str]:
    """What is told of a radar."""
    logs = track_logs(found)
    time = np.array([scan.time for scan in found.scans])
    counts = np.array([int(np.count_nonzero(scan.valid)) for scan in found.scans])
    lives = np.array([log.scans[-1].time - log.scans[0].time for log in logs])
    spanned = sum(int(log.number[-1] - log.number[0]) + 1 for log in logs)
    gaps = np.concatenate([np.diff(log.number) - 1 for log in logs])
    settled = innovations(logs)
    sigma, correlation = settled.value.std(axis=1), autocorrelation(settled)
    stated = next(iter(loaded.config.sensors.values())).sigmas()
    units = ("m", "degrees", "m/s")
    factors = (1.0, np.rad2deg(1.0), 1.0)
    rows = {
        "scans per second": f"{1 / np.median(np.diff(time)):.2f}",
        "time between scans, standard deviation": f"{1000 * np.diff(time).std():.1f} ms",
        "detections a scan": f"{counts.mean():.1f} ({counts.min()} to {counts.max()})",
        "tracks or objects begun per minute": f"{60 * len(logs) / (time[-1] - time[0]):.0f}",
        "how long one is seen, median (mean)": f"{np.median(lives):.2f} s ({lives.mean():.1f} s)",
        "seen in one to five scans": f"{100 * np.mean([len(log.number) <= 5 for log in logs]):.0f} %",
        "dropouts: scans without it, of those from its first to its last": f"{100 * gaps.sum() / spanned:.2f} %",
        "longest dropout": f"{0.05 * gaps.max():.2f} s",
    }
    for name, unit, factor, own, innovation, lag in zip(
        ("range", "azimuth", "range rate"), units, factors, stated, sigma, correlation, strict=True
    ):
        rows[f"innovation of {name}"] = f"{factor * innovation:.3f} {unit} (stated noise {factor * own:.2g})"
        rows[f"its correlation with the next, {name}"] = f"{lag:.2f}"
    rows["NIS (3 when consistent)"] = f"{settled.nis.mean():.2f}"
    return rows


def main() -> None:
    real, simulated = sensed(REAL), sensed(SIMULATED)
    logs = track_logs(real[1])
    share, error = share_along_sight(rate_slopes(logs))
    beside = [
        (what, a, b) for (what, a), b in zip(statistics(*real).items(), statistics(*simulated).values(), strict=True)
    ]
    print(f"share of the line of sight: {share:.2f} ± {error:.2f}")
    radars = markdown(("", "real", "simulated"), beside)
    fill(HERE / "comma2k19.md", {"doppler": doppler_table(logs), "radars": radars})


if __name__ == "__main__":
    main()
