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

    def switch(self, spacing: float) -> float:
        """Return the cost of an identity switch, m, where the instants are ``spacing`` s apart."""
        return self.cutoff * float(np.sqrt(self.switch_costs / spacing / 2)) if spacing else 0.0
