"""Effects of real sensors; ``EFFECTS`` holds the effects that a scenario can name."""

from trackbench.models.sensors.effects.base import EFFECTS, Bodies, Effect, Sensed
from trackbench.models.sensors.effects.processes import gauss_markov

__all__ = ["EFFECTS", "Bodies", "Effect", "Sensed", "gauss_markov"]
