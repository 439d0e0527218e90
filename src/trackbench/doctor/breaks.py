"""What it means that a tracker broke: a finding, or that it cannot be examined."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Finding
from trackbench.doctor.session import Broken
from trackbench.doctor.stations import OPEN
from trackbench.doctor.vitals import SINGULAR
from trackbench.errors import TrackbenchError
from trackbench.runner.adapters import cause_of
from trackbench.trackers.answers import TrackerFault

#: In the messages of NumPy and SciPy, where a Cholesky factor does not exist.
INDEFINITE = ("not positive definite",)
#: In those of math, NumPy and SciPy, of numbers that are none or lead to none.
NOT_NUMBERS = ("math domain error", "infs or NaNs", "did not converge")
_ORDINARY = tuple(station.name for station in OPEN)


class CannotRun(TrackbenchError):
    """A tracker raises, or gives what is no estimate, where nothing is out of the ordinary."""


def require_runnable(bench: Bench) -> None:
    """Follow targets of ordinary geometry with each sensor alone, and miss a measurement of each.

    Raises:
        CannotRun: the tracker cannot.
    """
    for station in OPEN:
        for name in bench.sensors:
            bench.reply(station, name, (name,))
            if bench.broken and _fault(bench.broken[-1][1].cause) != "nonfinite":
                raise _cannot(*bench.broken[-1])


def broken_findings(bench: Bench, found: Sequence[Finding]) -> list[Finding]:
    """What the errors say that a tracker raised in the examination.

    Args:
        bench: where it was examined.
        found: what was found otherwise.

    Raises:
        CannotRun: an error is none of a known kind, and nothing that was found explains it.
    """
    findings = []
    unexplained = []
    for where, broken in bench.broken:
        fault = _fault(broken.cause)
        ordinary = where in _ORDINARY
        if isinstance(broken.cause, TrackerFault) or (ordinary and fault != "nonfinite"):
            raise _cannot(where, broken)
        if fault is None:
            unexplained.append((where, broken))
        elif fault == "nonfinite" or where not in SINGULAR:
            findings.append(Finding(fault, 0.97, _said(where, broken), station=where))
    if unexplained and not (findings or found):
        raise _cannot(*unexplained[0])
    return findings


def _fault(cause: BaseException) -> str | None:
    if isinstance(cause, ArithmeticError):
        return "nonfinite"
    if any(words in str(cause) for words in INDEFINITE):
        return "covariance_not_psd"
    return "nonfinite" if any(words in str(cause) for words in NOT_NUMBERS) else None


def _cannot(where: str, broken: Broken) -> CannotRun:
    return CannotRun(_said(where, broken))


def _said(where: str, broken: Broken) -> str:
    scan = broken.scan
    measurement = "a measurement" if scan.valid.any() else "a missed measurement"
    return f"{cause_of(broken.cause)} (at {scan.time:.4g} s of {where}, at {measurement} of {scan.sensor})"
