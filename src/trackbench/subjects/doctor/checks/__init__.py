"""Checks of an examination; each looks for one family of faults.

A new module here is found by itself. It has functions that check a tracker under test, and the records of these checks.
"""
