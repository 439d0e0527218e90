"""Filters of other libraries as trackers; scenarios name them by entry points, and nothing else imports them."""

from trackbench.base.subjects import Subject

SUBJECT = Subject()
