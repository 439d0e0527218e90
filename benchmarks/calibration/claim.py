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


def rate(what: str, hits: Sequence[bool] | np.ndarray, low: float, high: float) -> Claim:
    """The claim that something happens in a share of independent trials between ``low`` and ``high``.

    It holds where the measured share is in between, so take enough trials: the Monte-Carlo error that is stated with
    the share (half of its 95 % interval) should be small beside the room that the claim leaves.
    """
    share = float(np.mean(hits))
    error = 1.96 * np.sqrt(max(share * (1 - share), 1 / len(hits)) / len(hits))
    wanted = f"{100 * low:g} to {100 * high:g} %" if low > 0 else f"at most {100 * high:g} %"
    if high >= 1:
        wanted = f"at least {100 * low:g} %"
    measured = f"{100 * share:.1f} ± {100 * error:.1f} % of {len(hits):,}"
    return Claim(what, measured, wanted, low <= share <= high)
