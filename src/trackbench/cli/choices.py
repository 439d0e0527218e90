"""A word out of a list, with the nearest one where it is misspelt."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

import click


class NearestChoice(click.Choice[str]):
    """Says which word may be meant."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        words = [str(choice) for choice in self.choices]
        begun = [word for word in words if word.startswith(str(value))]
        close = begun[:1] or get_close_matches(str(value), words, n=1, cutoff=0.5)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        return super().get_invalid_choice_message(value, ctx) + hint
