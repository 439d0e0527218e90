"""How a sensor differs from an ideal one. Effects are published under the entry points of ``EFFECTS``."""

from trackbench.models.sensors.effects.base import EFFECTS, Bodies, Effect, Sensed
from trackbench.models.sensors.effects.processes import gauss_markov

__all__ = ["EFFECTS", "Bodies", "Effect", "Sensed", "gauss_markov"]
