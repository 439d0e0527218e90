"""The checks of an examination: each looks for one family of faults.

A module here is found by itself. It has functions that make checks of a tracker under test, and their records.
"""
