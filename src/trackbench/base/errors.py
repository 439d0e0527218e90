"""Errors that a user can cause, each shown as one clear message, and helpers that word messages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path


class TrackbenchError(Exception):
    """Base of every error whose text is meant for the user."""


class OutputError(TrackbenchError):
    """Error of a result that cannot be written. The command line shows it and exits with status 4."""


class InputError(TrackbenchError):
    """Error in the input: a file, a key or an option. The command line shows it and exits with status 2.

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
        """Return this error, with the given file and line where the error states no file or line itself."""
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
        """Return these errors, with the given file and line where an error states no file or line itself."""
        return InputErrors([error.located(file=file, line=line) for error in self.errors])

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)


def similar_names(name: str, choices: Iterable[str], cutoff: float = 0.5) -> list[str]:
    """Return up to three choices with all words of ``name``, else one spelt like it by at least ``cutoff``, 0 to 1."""
    names = sorted(set(choices))
    spelling = re.sub("[- ]", "_", name.lower())
    if spelling in names:
        return [spelling]
    words = set(re.split(r"[_.]", spelling))
    whole = [choice for choice in names if words <= set(re.split(r"[_.]", choice.lower()))]
    return get_close_matches(spelling, whole, n=3, cutoff=0.0) or get_close_matches(name, names, n=1, cutoff=cutoff)


#: Largest number of choices that a message lists.
LISTED = 30


def nearest_choices(name: str, choices: Iterable[str]) -> str:
    """Return a sentence that names the choices nearest to ``name``, or lists all choices if none is near."""
    names = sorted(set(choices))
    if close := did_you_mean(similar_names(name, names)):
        return close
    if len(names) > LISTED:
        nearest = get_close_matches(name, names, n=5, cutoff=0.0)
        return f"choose from {len(names)}, such as {', '.join(nearest)}"
    return "choose from: " + ", ".join(names) if names else "there is none to choose from"


def did_you_mean(names: Sequence[str]) -> str:
    """Return a question such as "did you mean 'a', 'b' or 'c'?"; empty text for no names."""
    *rest, last = map(repr, names) if names else [""]
    return f"did you mean {' or '.join(filter(None, [', '.join(rest), last]))}?" if names else ""


def similar_path_hint(missing: Path) -> str:
    """Return a hint at a neighbour of a missing path, such as "; did you mean 'results/highway'?", else empty text."""
    neighbours = [entry.name for entry in missing.parent.iterdir()] if missing.parent.is_dir() else []
    hint = did_you_mean([str(missing.parent / name) for name in similar_names(missing.name, neighbours, 0.6)[:1]])
    return hint and f"; {hint}"


def shortened_text(text: str, most: int = 200) -> str:
    """Shorten a text of more than ``most`` characters to its start and end; leave a shorter text unchanged."""
    return text if len(text) <= most else f"{text[: most // 2]}...{text[-most // 2 :]}"


def printable(text: str, most: int = 1000) -> str:
    """Return the first ``most`` characters of a text in one line, with unprintable characters removed."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text[:most]).split())


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun, such as "2 runs"; ``plural`` is needed if it is not the noun plus an s."""
    return f"{number} {noun}" if number == 1 else f"{number} {plural or noun + 's'}"
