"""The errors that a user can cause, each shown as one clear message, and words of messages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path


class TrackbenchError(Exception):
    """Base of every error whose text is meant for the user."""


class OutputError(TrackbenchError):
    """A result cannot be written. The command line shows it and exits with status 4."""


class InputError(TrackbenchError):
    """Bad input: a file, a key or an option. The command line shows it and exits with status 2.

    Args:
        message: what is wrong and what would be right, in one line.
        key: dotted path of the key in the scenario file, for example ``sensors.front.rate_hz``.
        file: the file at fault.
        line: 1-based line in that file.
    """

    def __init__(
        self, message: str, *, key: str | None = None, file: Path | str | None = None, line: int | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.key = key
        self.file = file
        self.line = line

    def located(self, *, file: Path | str | None, line: int | None) -> InputError:
        """The same error with its place, where that was not known when it was raised."""
        return type(self)(self.message, key=self.key, file=self.file or file, line=self.line or line)

    def __str__(self) -> str:
        place = ":".join(shortened_text(str(part)) for part in (self.file, self.line) if part is not None)
        return ": ".join(filter(None, (place, shortened_text(self.key or ""), shortened_text(self.message, 2000))))


class InputErrors(InputError):
    """Several errors in one file, shown one per line.

    Args:
        errors: at least one, in the order in which they are shown.
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        first = errors[0]
        super().__init__(first.message, key=first.key, file=first.file, line=first.line)
        self.errors = tuple(errors)

    def located(self, *, file: Path | str | None, line: int | None) -> InputErrors:
        """The same errors, each with its place where that was not known."""
        return InputErrors([error.located(file=file, line=line) for error in self.errors])

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)


def similar_names(name: str, choices: Iterable[str], cutoff: float = 0.5) -> list[str]:
    """Return the choices that have all words of a name, else the one that is spelt most alike, as far as ``cutoff``."""
    names = sorted(set(choices))
    spelling = re.sub("[- ]", "_", name.lower())
    if spelling in names:
        return [spelling]
    words = set(re.split(r"[_.]", spelling))
    whole = [choice for choice in names if words <= set(re.split(r"[_.]", choice.lower()))]
    return get_close_matches(spelling, whole, n=3, cutoff=0.0) or get_close_matches(name, names, n=1, cutoff=cutoff)


#: More choices than these are not listed.
LISTED = 30


def nearest_choices(name: str, choices: Iterable[str]) -> str:
    """A sentence that names the nearest valid choices, or lists the choices when none is near."""
    names = sorted(set(choices))
    if close := did_you_mean(similar_names(name, names)):
        return close
    if len(names) > LISTED:
        nearest = get_close_matches(name, names, n=5, cutoff=0.0)
        return f"choose from {len(names)}, such as {', '.join(nearest)}"
    return "choose from: " + ", ".join(names) if names else "there is none to choose from"


def did_you_mean(names: Sequence[str]) -> str:
    """ "did you mean 'a', 'b' or 'c'?"; empty of no name."""
    *others, last = map(repr, names) if names else [""]
    return f"did you mean {' or '.join(filter(None, [', '.join(others), last]))}?" if names else ""


def similar_path_hint(missing: Path) -> str:
    """ "; did you mean 'results/highway'?", of what is beside a missing path; empty where nothing is alike."""
    there = [entry.name for entry in missing.parent.iterdir()] if missing.parent.is_dir() else []
    hint = did_you_mean([str(missing.parent / name) for name in similar_names(missing.name, there, 0.6)[:1]])
    return hint and f"; {hint}"


def shortened_text(text: str, most: int = 200) -> str:
    """The start and the end of a text of more than ``most`` characters."""
    return text if len(text) <= most else f"{text[: most // 2]}...{text[-most // 2 :]}"


def printable(text: str, most: int = 1000) -> str:
    """The start of a text in one line, without what no terminal or file can show."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text[:most]).split())


def counted(number: int, noun: str, plural: str = "") -> str:
    """ "1 run", "2 runs"; of a noun whose plural is not with an s alone, it is given."""
    return f"{number} {noun}" if number == 1 else f"{number} {plural or noun + 's'}"
