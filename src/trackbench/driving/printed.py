"""What plug-ins print, and errors of theirs that nothing catches: its start, without what a terminal would obey."""

from __future__ import annotations

import logging
import re
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, TextIO

from trackbench.base.errors import printable, text_of

#: Lines that are shown of what a plug-in prints, and characters of one on average.
LINES, LINE = 100, 200
_LINE = re.compile(r"[^\n]*\n|[^\n]+")


class Shown:
    """So many lines of a text that comes in parts; the rest is counted.

    Args:
        name: who prints.
        lines: how many are shown.
    """

    def __init__(self, name: str, lines: int = LINES) -> None:
        self.unshown = 0
        """Lines so far that are not."""
        self.lines = lines
        """Lines that are still to be shown."""
        self._name, self._characters = name, lines * LINE

    def admit(self, text: str) -> str:
        """What is to be shown of the next part, with spaces for control characters."""
        parts = []
        for line in _LINE.findall(text):
            whole = line.endswith("\n")
            if not self._more:
                self.unshown += whole
                continue
            parts.append(_visible(line[: self._characters]))
            self._characters -= len(line)
            self.lines -= whole
            if not self._more:
                start = "" if parts[-1].endswith("\n") else "\n"
                parts.append(f"{start}{self._name}: what it prints from here on is not shown\n")
        return "".join(parts)

    @property
    def _more(self) -> bool:
        return self.lines > 0 and self._characters > 0


def _visible(text: str) -> str:
    return "".join(letter if letter.isprintable() or letter in "\n\t" else " " for letter in text)


class ShownStream:
    """Standard output or error as a plug-in has it, which it cannot close."""

    def __init__(self, stream: TextIO, shown: Shown) -> None:
        self.stream: TextIO = stream.stream if isinstance(stream, ShownStream) else stream
        self._shown = shown

    def write(self, text: str) -> int:
        """Write what is to be shown."""
        # It may have been closed by its other name.
        with suppress(ValueError):
            self.stream.write(self._shown.admit(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several."""
        self.write("".join(lines))

    def close(self) -> None:
        """It belongs to the bench."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def say_stray_errors(who: Callable[[], str]) -> None:
    """From now on say in a line what is raised where nothing catches it.

    That is in a thread, in ``__del__``, in a record for a log, and in what a process does as it ends.

    Args:
        who: whom to name; where it is nobody, Python says it as ever.
    """
    shown = Shown("trackbench")
    threads, others, records = threading.excepthook, sys.unraisablehook, logging.Handler.handleError

    def say(error: BaseException | None) -> bool:
        name = who()
        if error is None or not name:
            return False
        # Imported here: it is needed where something goes wrong alone.
        from trackbench.base.user_code import Frame, last_of_user, place_of

        stack = [Frame(frame.filename, frame.lineno or 0, frame.name) for frame in traceback.extract_stack()]
        place = place_of(error, installed=False) or last_of_user(stack, installed=False)
        text = ": ".join(filter(None, (type(error).__name__, printable(text_of(error)))))
        where = "" if place is None else f" ({place})"
        with suppress(OSError, ValueError, AttributeError):
            print(
                f"{name}: an error that nothing caught: {text}{where}", file=ShownStream(sys.stderr, shown), flush=True
            )
        return True

    def in_thread(args: threading.ExceptHookArgs) -> None:
        if args.exc_type is not SystemExit and not say(args.exc_value):
            threads(args)

    def elsewhere(args: Any) -> None:
        if not say(args.exc_value):
            others(args)

    def in_record(handler: logging.Handler, record: logging.LogRecord) -> None:
        if not say(sys.exc_info()[1]):
            records(handler, record)

    threading.excepthook, sys.unraisablehook = in_thread, elsewhere
    logging.Handler.handleError = in_record  # type: ignore[method-assign, assignment]
