"""Formats of recorded traffic: one file each, published under the entry points of ``TRAFFIC_FORMATS``."""
