"""highway-env with tracks in place of the truth, as an environment of Gymnasium, and a driver for it."""

from trackbench.base.subjects import Subject

SUBJECT = Subject()
