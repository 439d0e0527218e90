"""What is asked of a track."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class TrafficScoreOptions(NamedTuple):
    """What is asked of a track."""

    cutoff: float = 5.0
    """m: distance of GOSPA, and of no similarity; up to half of it a track is on an object."""
    switch_costs: float = 0.5
    """s: a switch costs as much in T-GOSPA as missing the object for so long."""
    window: float = 5.0
    """s of OSPA(2)."""

    def switch(self, spacing: float, factor: float = 1.0) -> float:
        """m that a switch costs where the instants are ``spacing`` s apart, for ``factor`` times ``switch_costs``."""
        return self.cutoff * float(np.sqrt(factor * self.switch_costs / spacing / 2)) if spacing else 0.0
