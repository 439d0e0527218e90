"""Words for numbers of things, wherever a person reads them."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """ "1 run", "2 runs"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
