"""Measurements synthesised from ground truth and sensor models.

A ground truth and the sensors of a scenario come in; scans and the origins of their detections go out. Read
``scans.py`` first.
"""
