"""Filters of other libraries as trackers. Nothing here is imported but by the names under which it is published."""

from trackbench.base.subjects import Subject

SUBJECT = Subject()
