"""The check-up of a tracker on short synthetic drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import dropwhile
from typing import Any

import numpy as np
from pydantic import ValidationError

from trackbench.base import linalg
from trackbench.base.config.messages import explain
from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Scan
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import ISOLATED, is_program
from trackbench.driving.program import Program, ProgramTracker
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.testing import tracks
from trackbench.testing.rules import (
    LOST,
    NOISE,
    OF_OTHER_KIND,
    STATE_KEPT,
    Identities,
    TrackerCheckError,
    batched_scan,
    checked_answers,
    gives_reports,
    require_identities,
    require_state_kept,
)
from trackbench.trackers.answers import (
    GIVEN_UP,
    NOT_DEFINITE,
    NOT_FINITE,
    Tracker,
    TrackerFault,
    checked_estimate,
    is_random,
)
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.published import create

Make = Callable[[], Tracker]


@dataclass(frozen=True)
class Check:
    """One rule and whether the tracker keeps it."""

    rule: str
    problem: str | None
    """None where it is kept."""


def check_tracker(
    use: str | Mapping[str, Any] | Callable[..., Any], *, identities: Identities = "known", **options: Any
) -> list[Check]:
    """Try a tracker on short synthetic drives, as the bench would use it.

    Args:
        use: its class, a published name or ``"module:Class"``; of a program ``{"command": ["./my_tracker"]}``, as
            a scenario in the working directory names it.
        identities: ``hidden`` for a tracker of several objects, whose detections say nothing of their origin.
        options: what a scenario would give it.

    Returns:
        Every rule, all of them kept; of a tracker that draws random numbers (``random = True``) those that this allows.

    Raises:
        TrackerCheckError: rules are broken; says which and how.
        InputError: the tracker cannot be imported or started, or ``identities`` is another word.
    """
    require_identities(identities)
    with ExitStack() as programs:
        return _checked(_maker(use, identities, options, programs), identities, own_state=not isinstance(use, Mapping))


def _maker(
    use: str | Mapping[str, Any] | Callable[..., Any],
    identities: Identities,
    options: dict[str, Any],
    programs: ExitStack,
) -> Make:
    """What makes fresh trackers; a program that serves them ends with ``programs``."""
    if callable(use):
        return partial(use, **options)
    several = identities == "hidden"
    try:
        config = PluginConfig.model_validate({"use": use, "options": options})
    except ValidationError as invalid:
        raise InputError(explain(invalid, {})[0].message, key="use") from None
    if not is_program(config):
        return create(config.reference, config.options)
    try:
        program = Program(config, None, ISOLATED, several)
    except TrackFault as fault:
        raise InputError(f"cannot start {str(config.use)!r}: {fault}", key="use") from fault
    programs.callback(program.close)
    return partial(ProgramTracker, program)


def _checked(make: Make, identities: Identities, *, own_state: bool) -> list[Check]:
    rules, repeating = (RULES, REPEATING) if identities == "known" else (tracks.RULES, tracks.REPEATING)
    if not _draws(make):
        rules = rules | repeating
    if not own_state:
        # It is in the program, which is not given one.
        rules = {rule: test for rule, test in rules.items() if rule != STATE_KEPT}
    checks = [Check(rule, _problem(test, make)) for rule, test in rules.items()]
    broken: dict[str, list[str]] = {}
    for check in checks:
        if check.problem:
            broken.setdefault(check.problem, []).append(check.rule)
    if broken and _of_other_kind(make, identities):
        raise TrackerCheckError(OF_OTHER_KIND[identities])
    if broken:
        # A cause that breaks several rules is told once.
        lines = [f"- {'; '.join(names)}: {problem}" for problem, names in broken.items()]
        raise TrackerCheckError("the tracker breaks these rules:\n" + "\n".join(lines))
    return checks


def _draws(make: Make) -> bool:
    try:
        return is_random(make())
    except (Exception, SystemExit):
        return False


def _of_other_kind(make: Make, identities: Identities) -> bool:
    kinds = [lambda: (answer is not None for answer in _answers(make, _usual())), lambda: tracks.track_reports(make)]
    own, other = kinds if identities == "known" else kinds[::-1]
    return not gives_reports(own) and gives_reports(other)


def drive(
    kinds: Sequence[str],
    times: Sequence[float],
    missed: Sequence[int] = (),
    target: int = 0,
    velocity: tuple[float, float] = (0.0, 0.0),
) -> list[Scan]:
    """Measurements of a target that drives past a sensor which is neither at the origin nor looks along x.

    Args:
        kinds: "radar" or "lidar" of each scan.
        times: when each is taken, s.
        missed: numbers of the scans that do not detect the target.
        target: another number is another target and other noise.
        velocity: vx, vy of the sensor, m/s.
    """
    random = np.random.default_rng(target)
    own = np.array(velocity)
    scans = []
    for number, (kind, time) in enumerate(zip(kinds, times, strict=True)):
        model, noise = SENSOR_MODELS[kind], NOISE[kind]
        pose = np.array([4.0 + own[0] * time, -3.0 + own[1] * time, 0.4])
        ideal = model.measure(_target(time, target), pose, own)
        valid = np.array(number not in missed)
        measurement = np.where(valid, ideal + np.sqrt(np.diag(noise)) * random.standard_normal(len(ideal)), np.nan)
        # As in the bench, the arrays are read-only: a tracker that writes into them is found out.
        for shared in (measurement, valid, noise, pose, own):
            shared.setflags(write=False)
        scans.append(Scan(time, kind, kind, measurement, valid, noise, pose, own, time))
    return scans


def _target(time: float, target: int = 0) -> Array:
    """``(4,)`` px, py, vx, vy."""
    vx, vy = 12.0 - target, 3.0
    return np.array([20.0 + vx * time, 15.0 + 4.0 * target + vy * time, vx, vy])


def _usual(**changes: Any) -> list[Scan]:
    times = [0.05 * i for i in range(120)]
    return drive(["lidar", "radar"] * 60, times, **changes)


def _answers(make: Make, scans: Sequence[Scan]) -> Iterator[Estimate | None]:
    """What a fresh tracker says of a drive, each answer of the right form, finite and definite."""
    tracker, begun = make(), False
    batched = bool(getattr(tracker, "batched", False))
    measured = list(dropwhile(lambda scan: not scan.valid, scans))
    given = [batched_scan([scan]) if batched else scan for scan in measured]
    for scan, estimate in zip(measured, checked_answers(tracker, given, checked_estimate), strict=False):
        if estimate is None:
            if begun:
                raise TrackerFault(f"{GIVEN_UP} ({scan.time:g} s)")
            yield None
            continue
        if batched and np.isnan(estimate.mean).any() and not begun:
            yield None
            continue
        begun = True
        if not np.isfinite(estimate.mean.sum() + estimate.covariance.sum()):
            raise TrackerFault(f"{NOT_FINITE} at {scan.time:g} s")
        if not np.all(linalg.cholesky(estimate.covariance).positive):
            raise TrackerFault(f"{NOT_DEFINITE} at {scan.time:g} s")
        if batched:
            estimate = Estimate(estimate.mean[..., 0], estimate.covariance[..., 0])
        yield estimate


def _means(make: Make, scans: Sequence[Scan]) -> Array:
    """``(scans, 4, ...)`` estimates of a drive, those before the first left out."""
    return np.array([answer.mean for answer in _answers(make, scans) if answer is not None])


def _problem(test: Callable[[Make], object], make: Make) -> str | None:
    try:
        test(make)
    except (TrackerFault, TrackerCheckError) as fault:
        return str(fault)
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {error}"
    return None


def _gives_estimates(make: Make) -> None:
    if len(_means(make, _usual())) == 0:
        raise TrackerCheckError("120 measurements of one target give no estimate")


def _follows(**changes: Any) -> Callable[[Make], None]:
    def test(make: Make) -> None:
        scans = _usual(**changes)
        means = _means(make, scans)
        if len(means) == 0:
            raise TrackerCheckError("there is no estimate")
        error = float(np.hypot(*(means[-1, :2] - _target(scans[-1].time)[:2])))
        if not error < LOST:
            raise TrackerCheckError(f"after 120 measurements the estimate is {error:.1f} m off a target in plain sight")
        # On average: the differences of measurements that a tracker without a filter gives are noisy, but not biased.
        late = means[len(means) // 2 :, 2:].mean(axis=0)
        bias = float(np.hypot(*(late - _target(0.0)[2:])))
        if not bias < LOST:
            raise TrackerCheckError(f"the velocity is {bias:.1f} m/s off that of a target in plain sight, on average")

    return test


def _bears(scans: Callable[[], list[Scan]]) -> Callable[[Make], object]:
    return lambda make: list(_answers(make, scans()))


def _is_deterministic(make: Make) -> None:
    if not np.array_equal(_means(make, _usual()), _means(make, _usual())):
        raise TrackerCheckError("two fresh trackers give different estimates of the same measurements")


def _stands_alone(make: Make) -> None:
    """Two trackers at once do not disturb each other."""
    alone = _means(make, _usual(target=1))
    pairs = zip(_answers(make, _usual()), _answers(make, _usual(target=1)), strict=False)
    shared = np.array([answer.mean for _, answer in pairs if answer is not None])
    if not np.array_equal(alone[: len(shared)], shared):
        raise TrackerCheckError("a second tracker at work at the same time changes the estimates")


def _batch_is_loop(make: Make) -> None:
    if not getattr(make(), "batched", False):
        return
    missed: list[Sequence[int]] = [[0], [0, 9, 10], range(15)]
    targets = [_usual(target=target, missed=numbers) for target, numbers in enumerate(missed)]
    together = map(batched_scan, zip(*targets, strict=True))
    estimates = checked_answers(make(), together, checked_estimate)
    batch = [np.full((4, 3), np.nan) if estimate is None else estimate.mean for estimate in estimates]
    for target, alone in enumerate(targets):
        single = _means(make, alone)
        if not np.allclose(np.array(batch)[-len(single) :, :, target], single, rtol=1e-9, atol=1e-9):
            raise TrackerCheckError(f"target {target} of a batch of 3 has other estimates than alone")


RULES: dict[str, Callable[[Make], object]] = {
    "gives estimates of the right shape, finite, with a positive definite covariance": _gives_estimates,
    "follows a target in plain sight": _follows(),
    "follows it from a sensor that moves": _follows(velocity=(-10.0, -8.0)),
    "goes on through missed measurements": _bears(lambda: _usual(missed=[1, 5, 6, 30, *range(60, 90)])),
    "takes two sensors at the same instant": _bears(
        lambda: drive(["lidar", "radar"] * 40, [0.1 * (i // 2) for i in range(80)])
    ),
    "takes uneven time steps": _bears(lambda: drive(["radar", "lidar"] * 20, [0.01 * i**1.7 for i in range(40)])),
    "works with lidar alone": _bears(lambda: drive(["lidar"] * 60, [0.05 * i for i in range(60)])),
    "works with radar alone": _bears(lambda: drive(["radar"] * 60, [0.05 * i for i in range(60)])),
}
#: Those that compare two answers to the same.
REPEATING: dict[str, Callable[[Make], object]] = {
    "gives the same estimates every time": _is_deterministic,
    STATE_KEPT: lambda make: require_state_kept(
        make(), _usual()[:40], checked_estimate, "estimate", "another estimate"
    ),
    "does not disturb another tracker": _stands_alone,
    "gives a batch the same estimates as single targets (if batched)": _batch_is_loop,
}
