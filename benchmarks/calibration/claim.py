"""What a subject yields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Claim(NamedTuple):
    """One claim, and what became of it."""

    what: str
    measured: str
    wanted: str
    holds: bool
    decided: bool = True
    """Whether no limit of what is wanted lies within the Monte-Carlo error of what was measured."""
    excess: float | None = None
    """By how much the measurement is beyond what is wanted, negative within it; None where this is no number. Claims
    of one subject that want the same have the same unit."""

    @property
    def outcome(self) -> str:
        """What became of it: one of ``OUTCOMES``."""
        if self.wanted == STATED:
            return STATED
        return UNDECIDED if not self.decided else HOLDS if self.holds else FAILS


#: What is wanted of a number that is only stated, which neither holds nor fails.
STATED = "stated"
HOLDS, FAILS, UNDECIDED = "holds", "**fails**", "not decided by so many repeats"
OUTCOMES = (HOLDS, FAILS, UNDECIDED, STATED)


def rate(what: str, hits: Sequence[float] | np.ndarray, low: float, high: float) -> Claim:
    """The claim that something happens in a share of independent trials between ``low`` and ``high``.

    A hit is true or false, or the share of hits within a trial.

    It holds where the measured share is in between, and is decided where no limit is within the Monte-Carlo error that
    is stated with the share (half of its 95 % interval): take enough trials.
    """
    share = float(np.mean(hits))
    # Where there was no hit, or nothing else, as if there had been one.
    error = 1.96 * max(float(np.std(hits)), len(hits) ** -0.5) / len(hits) ** 0.5
    wanted = f"{100 * low:g} to {100 * high:g} %" if low > 0 else f"at most {100 * high:g} %"
    if high >= 1:
        wanted = f"at least {100 * low:g} %"
    measured = f"{100 * share:.1f} ± {100 * error:.1f} % of {len(hits):,}"
    decided = all(abs(share - limit) > error for limit in (low, high) if 0 < limit < 1)
    # A share is never beyond 0 or 1, which are no limits.
    excess = max([low - share] * (low > 0) + [share - high] * (high < 1), default=None)
    return Claim(what, measured, wanted, low <= share <= high, decided, excess)


def power(what: str, hits: Sequence[float] | np.ndarray, least: float = 0.0) -> Claim:
    """How often what is there is shown. Beside a rate of false alarms, which alone would be best where nothing is ever
    shown; it is only stated unless it has to be at least something.
    """
    claim = rate(f"power: {what}", hits, least, 1.0)
    return claim if least else claim._replace(wanted=STATED)
