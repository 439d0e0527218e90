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


def rate(what: str, hits: Sequence[float] | np.ndarray, low: float, high: float) -> Claim:
    """The claim that something happens in a share of independent trials between ``low`` and ``high``.

    A hit is true or false, or the share of hits within a trial.

    It holds where the measured share is in between, so take enough trials: the Monte-Carlo error that is stated with
    the share (half of its 95 % interval) should be small beside the room that the claim leaves.
    """
    share = float(np.mean(hits))
    # Where there was no hit, or nothing else, as if there had been one.
    error = 1.96 * max(float(np.std(hits)), len(hits) ** -0.5) / len(hits) ** 0.5
    wanted = f"{100 * low:g} to {100 * high:g} %" if low > 0 else f"at most {100 * high:g} %"
    if high >= 1:
        wanted = f"at least {100 * low:g} %"
    measured = f"{100 * share:.1f} ± {100 * error:.1f} % of {len(hits):,}"
    return Claim(what, measured, wanted, low <= share <= high)


def power(what: str, hits: Sequence[float] | np.ndarray, least: float = 0.0) -> Claim:
    """How often what is there is shown. Beside a rate of false alarms, which alone would be best where nothing is ever
    shown; it is only stated unless it has to be at least something.
    """
    claim = rate(f"power: {what}", hits, least, 1.0)
    return claim if least else claim._replace(wanted="stated")
