"""Checks for authors of plug-ins: whether a tracker, motion model or sensor keeps the bench's contract.

from trackbench.testing import check_tracker
check_tracker("mypkg.mymodule:MyTracker", alpha=0.5)
"""

from trackbench.testing.drives import drive
from trackbench.testing.models import ModelCheckError, check_motion_model, check_sensor
from trackbench.testing.rules import TrackerCheckError
from trackbench.testing.tracker import check_tracker

__all__ = [
    "ModelCheckError",
    "TrackerCheckError",
    "check_motion_model",
    "check_sensor",
    "check_tracker",
    "drive",
]
