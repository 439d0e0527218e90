"""Are the innovations of a log as large as the tracker's own covariance says, white, and of the right time?

All of them are the measurement minus that of the tracker's own prediction, by the right measurement model. A log is one
run, and its innovations are not independent: intervals come from the means of blocks of time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import gammaincinv, stdtrit

from trackbench.base.types import Array
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.checks.process_noise import BAND
from trackbench.subjects.doctor.exhibits import Course, OverTime
from trackbench.subjects.doctor.findings import Finding, PartResult, Question, doctor_check
from trackbench.subjects.doctor.log_doctor import CAUSES, LogInnovations, RecordedLog
from trackbench.subjects.doctor.session import NO_PREDICTION

_GROWTH = ("q_too_small", "q_too_large", "covariance_unbelievable")
#: Innovations of a sensor that are needed, and the blocks into which they are cut.
LEAST, BLOCKS = 60, 20
#: Share of the errors of a block mean that an interval leaves out on each side: where the limit is far from what is
#: right, and of a time offset, whose limit is 0.
OUTSIDE, OF_TIME = 5e-3, 5e-4
#: Share of innovations beyond the 95 % point of chi-square from which on they are too large, and the mean over the
#: degrees of freedom below which they are too small. A filter that is tuned for other manoeuvres is in between.
BEYOND, SMALL = 0.2, 0.35
#: Autocorrelation of successive innovations that is no tuning: of an estimate that lags, and of one that chases noise.
LAGS, CHASES = 0.4, -0.3
#: Mean of the whitened innovation that no manoeuvre explains.
OFF = 1.0
#: Implied over stated variance that still is a tuning, and its spread over the scans (ratio of 90 % to 10 % points) up
#: to which it is that of a Kalman filter.
NOISE_BAND, SPREAD = 3.0, 1.5
#: Least time offset, s; by how much it has to reduce the mean NIS; the offsets that are tried, over the fitted one,
#: which the filter takes up in part.
OFFSET, BETTER, TRIED = 0.01, 0.05, (0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
#: Difference of an update from the right one that no filter has, in standard deviations of the prediction.
APART = 3.0
#: Autocorrelation from which on innovations that are too large come from an estimate that lags; it is the process noise
#: where that is below what fits road vehicles.
LAGGING = 0.2


def block_interval(values: Array, outside: float = OUTSIDE) -> tuple[float, float, float]:
    """The mean of ``(k,)`` successive values and the ends of its interval, from the means of blocks."""
    means = np.array([block.mean() for block in np.array_split(values, BLOCKS)])
    reach = float(stdtrit(BLOCKS - 1, 1.0 - outside) * means.std(ddof=1) / np.sqrt(BLOCKS))
    mean = float(means.mean())
    return mean, mean - reach, mean + reach


@doctor_check(
    Question(
        "log_noise",
        "Does the covariance change as the stated noise says?",
        "Does the covariance change as the stated noise of {sensor} says?",
        each_sensor=True,
        misses=True,
    ),
    place=40,
)
def log_noise(log: RecordedLog) -> PartResult:
    """Compare the variance that the change of the covariance implies with the stated one."""
    result = PartResult()
    for sensor, of in _judged(log, result, "log_noise"):
        implied, names = of.stacked(of.implied), SENSOR_MODELS[of.kind].components
        with np.errstate(all="ignore"):
            low, factor, high = np.nanquantile(implied, [0.1, 0.5, 0.9], axis=1)
        parts = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in zip(names, factor, strict=True))
        text = f"the covariance changes as with {parts} times the stated variances (medians of {len(of.time)})"
        if np.isnan(implied).mean() > 0.1 or not np.all(high <= SPREAD * low):
            result.add(f"log_noise.{sensor}", None, f"it does not change as that of a Kalman filter; {text}")
            continue
        wrong = np.maximum(factor, 1.0 / factor) > NOISE_BAND
        finding = None
        if wrong.any():
            size = float(np.exp(np.mean(np.log(factor[wrong]))))
            fault = "r_too_small" if size < 1.0 else "r_too_large"
            finding = Finding(fault, 0.9, text, sensor=sensor, factor=size)
        result.add(f"log_noise.{sensor}", finding is None, text, finding)
    return result


@doctor_check(
    Question(
        "log_timing",
        "Are the innovations without a trace of a time offset?",
        "Are the innovations of {sensor} without a trace of a time offset?",
        each_sensor=True,
        misses=True,
    ),
    place=50,
)
def timing(log: RecordedLog) -> PartResult:
    """Fit the time by which the measurements of each sensor are off, and try the largest one on the tracker."""
    result, fits = PartResult(), {}
    for sensor, of in _judged(log, result, "log_timing"):
        rate, whitened = of.stacked(of.rate), of.stacked(of.whitened)
        power = float(np.mean(np.sum(rate**2, axis=0)))
        interval = block_interval(np.sum(whitened * rate, axis=0), OF_TIME)
        fits[sensor] = tuple(value / power for value in interval)
    largest = max(fits, key=lambda sensor: abs(fits[sensor][0]), default="")
    for sensor, (offset, low, high) in fits.items():
        text = f"the innovations are those of measurements {_of_time(offset)} ({1e3 * low:.3g} to {1e3 * high:.3g} ms)"
        off = min(abs(low), abs(high)) > 0.0 and low * high > 0.0 and abs(offset) > OFFSET
        finding = _tried(log, sensor, offset) if off and sensor == largest else None
        # What another sensor's offset does to this one's is no fault of its own.
        result.add(f"log_timing.{sensor}", finding is None, text, finding)
    return result


def _of_time(offset: float) -> str:
    return f"{1e3 * abs(offset):.3g} ms {'after' if offset > 0.0 else 'before'} the time of the scan"


def _tried(log: RecordedLog, sensor: str, offset: float) -> Finding | None:
    """The offset with which the tracker's innovations are smallest, if they are clearly smaller."""
    before = log.followed.nis
    nis = {share * offset: log.shifted(sensor, share * offset).nis for share in TRIED}
    best = min(nis, key=lambda moved: nis[moved])
    # Of an estimate that lags the innovations are large for another reason.
    if not nis[best] < min((1.0 - BETTER) * before, max(1.0, 0.5 * (1.0 + before))):
        return None
    others = ", or those of the others the other way" if len(log.sensors) > 1 else ""
    text = (
        f"measurements of {sensor} fit the predictions best {_of_time(best)}{others}: the mean NIS over its degrees of "
        f"freedom is {nis[best]:.3g} with times so moved, and {before:.3g} as they are"
    )
    return Finding("time_offset", 0.92, text, sensor=None if others else sensor)


@doctor_check(
    Question(
        "log_nis",
        "Are the innovations as large as the own covariance and the stated noise say?",
        "Are the innovations of {sensor} as large as the own covariance and its stated noise say?",
        each_sensor=True,
        misses=True,
        finds=_GROWTH,
        shows=CAUSES,
    ),
    Question(
        "log_whiteness",
        "Are successive innovations uncorrelated?",
        "Are successive innovations of {sensor} uncorrelated?",
        each_sensor=True,
        misses=True,
        finds=_GROWTH,
        shows=CAUSES,
    ),
    Question(
        "log_mean",
        "Is the mean of the innovations zero?",
        "Is the mean of the innovations of {sensor} zero?",
        each_sensor=True,
        misses=True,
        finds=("sensor_bias",),
        shows=(*CAUSES, *_GROWTH),
    ),
    place=60,
)
def log_innovations(log: RecordedLog) -> PartResult:
    """Judge the mean, the size and the correlation of the innovations of each sensor."""
    result, growth = PartResult(), dict[str, Finding]()
    for sensor, of in _judged(log, result, "log_nis", "log_whiteness", "log_mean"):
        # A bias has a check of its own.
        whitened = of.stacked(of.whitened)
        whitened = whitened - whitened.mean(axis=1, keepdims=True)
        nis = np.sum(whitened**2, axis=0)
        size, _, above = (one / len(whitened) for one in block_interval(nis))
        point = float(2 * gammaincinv(len(whitened) / 2, 0.95))
        share, least, most = block_interval((nis > point).astype(float))
        products = np.sum(whitened[:, 1:] * whitened[:, :-1], axis=0) / np.mean(nis)
        correlation, low, high = block_interval(products)
        text = (
            f"the mean NIS over its degrees of freedom is {size:.3g}, and {share:.1%} ({max(least, 0.0):.1%} to "
            f"{min(most, 1.0):.1%}) are beyond its 95 % point"
        )
        large, small = least > BEYOND, above < SMALL
        if large or small or low > LAGS:
            per_second = float(np.sqrt(max(np.median(log.followed.growth), 0.0)))
            lags = not small and correlation > LAGGING and per_second < BAND[0]
            fault = "q_too_small" if lags else "covariance_unbelievable"
            fault = "q_too_large" if small and per_second > BAND[1] else fault
            evidence = (
                f"{text} (sensor {sensor}); the correlation of successive innovations is {correlation:.2f}, and in 1 s "
                f"the standard deviation of the speed grows by {per_second:.3g} m/s"
            )
            growth.setdefault(fault, Finding(fault, 0.82, evidence, exhibit=_shown(sensor, of)))
        result.add(f"log_nis.{sensor}", not (large or small), text)
        text = f"the correlation of successive innovations is {correlation:.2f} ({low:.2f} to {high:.2f}; 0 expected)"
        result.add(f"log_whiteness.{sensor}", not (low > LAGS or high < CHASES), text)
        _mean(result, sensor, of, lags=bool(large or low > LAGS))
    result.findings += growth.values()
    return result


def _mean(result: PartResult, sensor: str, of: LogInnovations, lags: bool) -> None:
    """Judge the mean; of an estimate that lags it is no bias of the sensor."""
    names, parts, off = SENSOR_MODELS[of.kind].components, [], []
    for name, values in zip(names, of.stacked(of.whitened), strict=True):
        mean, low, high = block_interval(values)
        parts.append(f"{name.replace('_', ' ')} {mean:+.2f}")
        off += [name] if min(abs(low), abs(high)) > OFF and low * high > 0.0 else []
    text = f"the mean innovations, in their own standard deviations: {', '.join(parts)}"
    biased = bool(off) and not lags
    finding = Finding("sensor_bias", 0.85, text, sensor=sensor, exhibit=_shown(sensor, of)) if biased else None
    result.add(f"log_mean.{sensor}", not off, text, finding)


@doctor_check(
    Question(
        "log_wrapping",
        "Is an azimuth wrapped where it passes pi?",
        "Is the azimuth of {sensor} wrapped where it passes pi?",
        each_sensor=True,
        misses=True,
    ),
    place=55,
)
def log_wrapping(log: RecordedLog) -> PartResult:
    """Compare the updates where the difference of two angles passes pi with what the own covariance says."""
    result = PartResult()
    for sensor, of in _judged(log, result, "log_wrapping"):
        crossing = np.array(of.crosses, dtype=bool)
        if not crossing.any():
            result.add(f"log_wrapping.{sensor}", None, "no azimuth passes pi between prediction and measurement")
            continue
        apart = np.array(of.apart)
        here, elsewhere = float(np.median(apart[crossing])), float(np.quantile(apart[~crossing], 0.9))
        text = (
            f"where the azimuth passes pi between prediction and measurement ({crossing.sum()} scans), the update "
            f"differs by {here:.3g} standard deviations from that of the own covariance; elsewhere by {elsewhere:.3g} "
            "(90 % point)"
        )
        unlike = here > max(APART, 3.0 * elsewhere)
        finding = Finding("azimuth_not_wrapped", 0.95, text, sensor=sensor) if unlike else None
        result.add(f"log_wrapping.{sensor}", not unlike, text, finding)
    return result


def _shown(sensor: str, of: LogInnovations) -> OverTime:
    """The whitened innovations of the object that is followed longest."""
    owner = np.array(of.owner)
    chosen = owner == np.bincount(owner).argmax()
    band = np.full(int(chosen.sum()), 2.0)
    names = SENSOR_MODELS[of.kind].components
    courses = tuple(
        Course(f"{name.replace('_', ' ')}, sigma", values[chosen], band=(-band, band), band_name="2 sigma")
        for name, values in zip(names, of.stacked(of.whitened), strict=True)
    )
    return OverTime(f"Innovations of {sensor}", "time, s", np.array(of.time)[chosen], courses)


def _judged(log: RecordedLog, result: PartResult, *names: str) -> Iterator[tuple[str, LogInnovations]]:
    """The innovations of each sensor that are judged; of the others the named checks are added with the reason."""
    for sensor in log.sensors:
        of = log.followed.innovations.get(sensor, LogInnovations(""))
        why = f"{len(of.time)} innovations, of {LEAST} needed" if len(of.time) < LEAST else None
        why = why if log.followed.moved else NO_PREDICTION
        if why is None:
            yield sensor, of
        else:
            for name in names:
                result.add(f"{name}.{sensor}", None, why)
