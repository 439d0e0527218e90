"""What the user states of the tracker and its sensors, and the checks that are not made for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trackbench.subjects.doctor.check_list import KnownCheck, checks
from trackbench.subjects.doctor.findings import CheckResult, Finding, PartResult


@dataclass(frozen=True)
class Assumptions:
    """What an examination takes for granted."""

    no_misses: bool = False
    """Every scan has a detection."""
    skip: tuple[str, ...] = ()
    """Checks that the user does not ask for, by name or by name and sensor: ``gain``, ``gain.radar``."""
    still: str = ""
    """Why no observer moves; nothing where one does."""

    def left_out(self, part: str, sensors: Sequence[str], why: str | None = None) -> list[CheckResult]:
        """The checks of a part that are not made, with the reason.

        Args:
            part: the function that makes them.
            sensors: those for each of which it makes some.
            why: of all others of it too.
        """
        found = []
        for name, check in _of(part).items():
            reason = why if self._reason(check) is None else self._reason(check)
            for one in [f"{name}.{sensor}" for sensor in sensors] if check.each_sensor else [name]:
                if name in self.skip or one in self.skip:
                    found.append(CheckResult(one, check.asks, None, "skipped (--skip)", skipped=True))
                elif reason is not None:
                    found.append(CheckResult(one, check.asks, None, reason))
        return found

    def applied(self, result: PartResult, left_out: Sequence[CheckResult], part: str) -> PartResult:
        """The result of a part, with the checks that are not made in place of what was found by them."""
        names = {check.name for check in left_out}
        made = [check for check in result.checks if check.name not in names]
        return PartResult([*made, *left_out], [one for one in result.findings if not self._drops(one, part)])

    def _reason(self, check: KnownCheck) -> str | None:
        if check.misses and self.no_misses:
            return "it needs scans without a detection (--no-misses)"
        return f"it needs an observer that moves ({self.still})" if check.motion and self.still else None

    def _drops(self, finding: Finding, part: str) -> bool:
        """Whether a finding is that of a check that is not made."""
        for name, check in _of(part).items():
            if finding.fault in check.finds and (name in self.skip or self._reason(check) is not None):
                return True
        return any(f"{name}.{finding.sensor}" in self.skip for name in _of(part))


NONE = Assumptions()


def _of(part: str) -> dict[str, KnownCheck]:
    return {name: check for name, check in checks().items() if check.part == part}
