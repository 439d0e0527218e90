"""How a tracker is stepped: in this process where it is built in, in one of its own where it is not."""

from trackbench.stepping.faults import TrackFault, fault_of
from trackbench.stepping.remote import ISOLATED, Isolation, check, fresh, start, start_tracks
from trackbench.stepping.steppers import Direct, Stepper, masked

__all__ = [
    "ISOLATED",
    "Direct",
    "Isolation",
    "Stepper",
    "TrackFault",
    "check",
    "fault_of",
    "fresh",
    "masked",
    "start",
    "start_tracks",
]
