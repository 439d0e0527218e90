"""Formats of recorded traffic, each a file published under the entry points of ``TRAFFIC_FORMATS``."""
