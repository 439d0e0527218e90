"""Errors of a tracker that nothing catches, each said in one line."""

from __future__ import annotations

import logging
import sys
import threading
import traceback
from contextlib import suppress
from typing import Any

from trackbench.base.errors import printable, text_of


def say_stray_errors(name: str) -> None:
    """From now on say in a line what is raised where nothing catches it.

    That is in a thread, in ``__del__``, in a record for a log, and in what a process does as it ends.

    Args:
        name: whose errors they are.
    """
    threads, others, records = threading.excepthook, sys.unraisablehook, logging.Handler.handleError

    def say(error: BaseException | None) -> bool:
        if error is None:
            return False
        # Imported here: it is needed where something goes wrong alone.
        from trackbench.base.user_code import Frame, last_of_user, place_of

        stack = [Frame(frame.filename, frame.lineno or 0, frame.name) for frame in traceback.extract_stack()]
        place = place_of(error, installed=False) or last_of_user(stack, installed=False)
        text = ": ".join(filter(None, (type(error).__name__, printable(text_of(error)))))
        where = "" if place is None else f" ({place})"
        with suppress(OSError, ValueError, AttributeError):
            print(f"{name}: an error that nothing caught: {text}{where}", file=sys.stderr, flush=True)
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
