"""Why a tracker cannot go on, and where in its code."""

from __future__ import annotations

from typing import Any, Literal, NoReturn, get_args

from trackbench.base.errors import InputError, InputErrors, TrackbenchError, printable, text_of
from trackbench.base.user_code import place_of
from trackbench.trackers.answers import TrackerFault

#: Invalid output; a failed calculation; any other exception; a process that died or was ended.
Kind = Literal["answer", "arithmetic", "raised", "died"]
KINDS = get_args(Kind)

#: What Python raises where something asks for input and there is none: a debugger, ``input()``.
ASKING = ("BdbQuit", "EOFError")


class TrackFault(Exception):
    """A tracker cannot go on.

    Args:
        cause: what went wrong, in one line.
        kind: what sort of fault it is.
        place: file, line and function of the tracker's code, where it is known.
        member: number of the member of the batch that it happened to, where it is known.
    """

    def __init__(self, cause: str, kind: Kind, place: str | None = None, member: int | None = None) -> None:
        super().__init__(cause)
        self.cause = cause
        self.kind: Kind = kind
        self.place = place
        self.member = member

    def __str__(self) -> str:
        return self.cause if self.place is None else f"{self.cause} ({self.place})"


def fault_of(error: BaseException, member: int | None = None) -> TrackFault:
    """An error in a tracker as a fault."""
    if isinstance(error, TrackFault):
        return error
    kind: Kind = "raised"
    if isinstance(error, TrackerFault):
        kind = "answer"
    elif isinstance(error, ArithmeticError):
        kind = "arithmetic"
    return TrackFault(_cause(error), kind, place_of(error), member)


def _cause(error: BaseException) -> str:
    name, text = type(error).__name__, text_of(error)
    if not isinstance(error, TrackbenchError):
        # An error of a package may explain itself at length.
        text = text.strip().partition("\n")[0]
    text = printable(text)
    if isinstance(error, TrackbenchError | TrackerFault):
        return text or name
    if name in ASKING:
        text += " (a process of its own has no terminal; see --in-process)"
    return f"{name}: {text.strip()}" if text else name


def error_message(error: BaseException) -> dict[str, Any]:
    """Return the message by which the process of a tracker reports an error."""
    if isinstance(error, InputError | InputErrors):
        problems = error.errors if isinstance(error, InputErrors) else [error]
        return {"type": "error", "input": [[each.message, each.key] for each in problems]}
    fault = fault_of(error)
    return {"type": "error", "message": fault.cause, "kind": fault.kind, "place": fault.place, "member": fault.member}


def raise_reported(message: dict[str, Any], members: int) -> NoReturn:
    """Raise the error that a message reports.

    Raises:
        InputError, TrackFault: the reported error.
        KeyError, TypeError, ValueError: the report is malformed.
    """
    if problems := message.get("input"):
        errors = [InputError(str(message), key=None if key is None else str(key)) for message, key in problems]
        raise errors[0] if len(errors) == 1 else InputErrors(errors)
    kind, place, member = (message[name] for name in ("kind", "place", "member"))
    if kind not in KINDS or not (member is None or (isinstance(member, int) and 0 <= member < members)):
        raise ValueError(message)
    raise TrackFault(str(message["message"]), kind, None if place is None else str(place), member)
