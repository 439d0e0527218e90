"""Estimates and truth to numbers with a unit, an interval and a verdict."""
