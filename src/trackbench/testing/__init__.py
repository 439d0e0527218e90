"""Check-ups for the authors of plug-ins: does it keep the contract that the bench relies on?

from trackbench.testing import check_tracker
check_tracker("mypkg.mymodule:MyTracker", alpha=0.5)
"""

from trackbench.testing.drives import drive
from trackbench.testing.models import ModelCheckError, check_motion_model, check_sensor
from trackbench.testing.rules import TrackerCheckError
from trackbench.testing.tracker import Check, check_tracker

__all__ = [
    "Check",
    "ModelCheckError",
    "TrackerCheckError",
    "check_motion_model",
    "check_sensor",
    "check_tracker",
    "drive",
]
