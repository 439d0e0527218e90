"""Interface of a tracker, and the check of the estimate or tracks that its ``step`` returns."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks

NOT_FINITE = "the estimate is not finite"
NOT_DEFINITE = "the covariance is not positive definite"
TOO_LARGE = "the error, or its ratio to the covariance, is too large for any score"
GIVEN_UP = "it gave None after an estimate: from then on each scan needs one; predict where a measurement is missed"

OF_ONE = "it gave an estimate of one object; with hidden identities step must return (state, Tracks)"
OF_SEVERAL = "it gave tracks of several objects, which need sensing: {identities: hidden}"
#: Placeholder for the state of a tracker in another process or program, which stores it there.
KEPT_THERE = "kept there"
#: Id of padding in the tracks of several runs.
NO_TRACK = -1
#: Name, in messages, of what a multi-object tracker's ``step`` returns beside the state.
TRACKS = "Tracks"

#: Largest difference of mirrored entries of a covariance, relative to its largest entry.
ASYMMETRY = 1e-6


class Tracker(Protocol):
    """Tracker of one object; with a class attribute ``batched = True``, of a batch of objects.

    A tracker that draws random numbers, such as a particle filter, has a class attribute ``random = True``.
    """

    def step(self, state: Any, scan: Scan) -> tuple[Any, Estimate | tuple[Array, Array] | None]:
        """Return the tracker's new state and the estimate after a scan.

        ``state`` is None at the first measurement and is never changed in place. The estimate is None until the tracker
        has one; a batched tracker returns NaN for an object without an estimate yet.
        """
        ...


class TrackerFault(Exception):
    """Error for an invalid value returned by a tracker."""


def require_continued(answer: Any, estimated: bool, finite: bool = True) -> None:
    """Raise an error if an estimate ends once there was one, or, with ``finite``, if it is not finite.

    Args:
        answer: value that ``step`` returned; a mean of only NaN counts as a missing estimate.
        estimated: whether the tracker has returned an estimate before.
        finite: whether an estimate must be finite.

    Raises:
        TrackerFault: the estimate has ended or is not finite.
    """
    if answer is None and estimated:
        raise TrackerFault(GIVEN_UP)
    if not finite or not isinstance(answer, Estimate) or np.isnan(answer.mean).all():
        return
    if not np.isfinite(answer.mean.sum() + answer.covariance.sum()):
        raise TrackerFault(NOT_FINITE)


def is_random(tracker: Any) -> bool:
    """Return whether a tracker declares ``random = True``; another value, such as a generator, counts as False."""
    return any(getattr(owner, "random", None) is True for owner in (type(tracker), tracker))


def unpack(answer: Any, what: str = "estimate") -> tuple[Any, Any]:
    """Return the new state and the answer in the pair that ``step`` returned; ``what`` names the answer in errors."""
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise TrackerFault(f"step must return (state, {what}), not {_described(answer)}")
    return answer


def checked_estimate(answer: Any, scan: Scan) -> Estimate | None:
    """Return the estimate, if any, in a tracker's answer, after a check of shapes and of the covariance's symmetry.

    Raises:
        TrackerFault: the answer is not a mean (4, ...) with a symmetric covariance (4, 4, ...).
    """
    estimate = shaped_estimate(answer, scan)
    if estimate is not None:
        _require_symmetric(estimate.covariance)
    return estimate


def shaped_estimate(answer: Any, scan: Scan) -> Estimate | None:
    """Return the estimate in a tracker's answer, after a check of its shapes alone; None if there is none.

    Raises:
        TrackerFault: the answer is not a mean (4, ...) with a covariance (4, 4, ...).
    """
    if answer is None:
        return None
    if not isinstance(answer, Estimate):
        if isinstance(answer, tuple) and 3 <= len(answer) <= 5:
            raise TrackerFault(OF_SEVERAL)
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise TrackerFault(f"step must return (state, (mean, covariance)), not (state, {_described(answer)})")
        answer = Estimate(*answer)
    batch = np.shape(scan.valid)
    innovation, spread, modes = answer.innovation, answer.innovation_covariance, answer.mode_probabilities
    if innovation is not None and spread is not None:
        size = len(np.atleast_1d(innovation))
        innovation = _shaped_array("innovation", innovation, (size, *batch))
        spread = _shaped_array("innovation covariance", spread, (size, size, *batch))
    if modes is not None:
        modes = _shaped_array("array of mode probabilities", modes, (len(np.atleast_1d(modes)), *batch))
    if answer.repaired is not None and np.shape(answer.repaired) != batch:
        raise TrackerFault(f"repaired has the shape {np.shape(answer.repaired)}, where {batch} is needed")
    checked: Estimate = answer._replace(
        mean=_shaped_array("mean", answer.mean, (4, *batch)),
        covariance=_shaped_array("covariance", answer.covariance, (4, 4, *batch)),
        innovation=innovation,
        innovation_covariance=spread,
        # The bench computes this itself.
        whitened_innovation=None,
        mode_probabilities=modes,
        log_likelihood=None,
    )
    return checked


def tracks_of_run(tracks: Tracks, run: int) -> Tracks:
    """Return the tracks of the run with an index, without the padding of a batch of runs."""
    is_track = tracks.ids[:, run] != NO_TRACK
    return Tracks(*(None if part is None else part[..., is_track, run] for part in tracks))  # type: ignore[arg-type]


def checked_tracks(answer: Any, scan: Scan) -> Tracks:
    """Return the tracks in a tracker's answer, of one run or many, after a check; no tracks for None.

    Raises:
        TrackerFault: the answer is invalid; says why.
    """
    runs = np.shape(scan.valid)[1:]
    if answer is None:
        return Tracks(np.zeros((0, *runs), dtype=np.intp), np.zeros((4, 0, *runs)), np.zeros((4, 4, 0, *runs)))
    if isinstance(answer, Estimate) or (isinstance(answer, tuple) and len(answer) == 2):
        raise TrackerFault(OF_ONE)
    if not isinstance(answer, tuple) or not 3 <= len(answer) <= 5:
        wanted = "Tracks(ids, mean, covariance, existence=None, used=None)"
        raise TrackerFault(f"the answer must be {wanted} or None, not {_described(answer)}")
    tracks = Tracks(*answer)
    shape = (*np.shape(tracks.ids)[:1], *runs)
    ids = _whole_numbers("ids", tracks.ids, shape)
    mean = _shaped_array("mean", tracks.mean, (4, *shape))
    covariance = _shaped_array("covariance", tracks.covariance, (4, 4, *shape))
    is_track = ids != NO_TRACK
    # Only tracks of several runs are padded.
    if np.any(ids < (NO_TRACK if runs else 0)):
        raise TrackerFault(f"an id is {ids.min()}; ids count from 0")
    ordered = np.sort(ids, axis=0)
    is_repeated = (np.diff(ordered, axis=0) == 0) & (ordered[1:] != NO_TRACK)
    if np.any(is_repeated):
        raise TrackerFault(f"two tracks have the id {ordered[1:][is_repeated][0]}")
    require_covariances(ids[is_track], mean[:, is_track], covariance[:, :, is_track])
    existence = None if tracks.existence is None else _shaped_array("existence", tracks.existence, shape)
    if existence is not None:
        is_wrong = is_track & ~((existence >= 0) & (existence <= 1))
        if is_wrong.any():
            message = f"the existence probability of track {ids[is_wrong][0]} is {existence[is_wrong][0]:g}"
            raise TrackerFault(f"{message}, which is not between 0 and 1")
    used = None if tracks.used is None else _whole_numbers("used", tracks.used, shape)
    if used is not None and is_track.any():
        count = np.broadcast_to(np.count_nonzero(scan.valid, axis=0), shape)
        is_wrong = is_track & ((used < NO_TRACK) | (used >= count))
        if is_wrong.any():
            raise TrackerFault(f"used names detection {used[is_wrong][0]}, where the scan has {count[is_wrong][0]}")
    return Tracks(ids, mean, covariance, existence, used)


def require_covariances(ids: Indices, mean: Array, covariance: Array) -> None:
    """Raise an error unless each estimate is finite and each covariance symmetric and positive definite."""
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        wrong = int(np.flatnonzero(~np.isfinite(mean.sum(axis=0) + covariance.sum(axis=(0, 1))))[0])
        part, value = ("mean", mean) if not np.isfinite(mean[:, wrong]).all() else ("covariance", covariance)
        numbers = np.array2string(value[..., wrong], precision=4, separator=", ").replace("\n", "")
        raise TrackerFault(f"{NOT_FINITE}: track {ids[wrong]} has the {part} {numbers}")
    _require_symmetric(covariance)
    is_positive = linalg.cholesky(covariance).positive
    if not is_positive.all():
        wrong = int(np.flatnonzero(~is_positive)[0])
        smallest = np.linalg.eigvalsh(covariance[..., wrong])[0]
        raise TrackerFault(f"{NOT_DEFINITE}: that of track {ids[wrong]} has the eigenvalue {smallest:.3g}")


def _require_symmetric(covariance: Array) -> None:
    if (covariance == np.swapaxes(covariance, 0, 1)).all():
        return
    with np.errstate(invalid="ignore"):
        gap = np.abs(covariance - np.swapaxes(covariance, 0, 1)).max(axis=(0, 1), initial=0.0)
    if np.any(gap > ASYMMETRY * np.abs(covariance).max(axis=(0, 1), initial=0.0)):
        raise TrackerFault(f"the covariance is not symmetric: mirrored entries differ by up to {np.nanmax(gap):.3g}")


def _whole_numbers(what: str, value: Any, shape: tuple[int, ...]) -> Indices:
    # Programs send every number as float64.
    array = _shaped_array(f"array of {what}", value, shape)
    if not np.all((np.abs(array) < 1 << 53) & (array == np.floor(array))):
        raise TrackerFault(f"the {what} are not whole numbers: {_described(value)}")
    return array.astype(np.intp)


def _shaped_array(what: str, value: Any, shape: tuple[int, ...]) -> Array:
    try:
        if np.iscomplexobj(value):
            raise TypeError
        if np.ma.isMaskedArray(value):
            value = np.ma.filled(value.astype(float), np.nan)
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise TrackerFault(f"the {what} is not an array of numbers: {_described(value)}") from None
    if array.shape != shape:
        raise TrackerFault(f"the {what} has the shape {array.shape}, where {shape} is needed")
    return array


def _described(value: Any) -> str:
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '...'}"
