"""Faults of trackers: their cause and their place in the tracker's code."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Literal, get_args

from trackbench.base.errors import InputError, InputErrors, TrackbenchError, printable
from trackbench.base.user_code import place_of
from trackbench.trackers.answers import TrackerFault

#: Kinds of fault: invalid output, failed calculation, any other exception, a process that died or was ended.
Kind = Literal["answer", "arithmetic", "raised", "died"]
KINDS = get_args(Kind)

#: Exceptions of a debugger or of ``input()`` in a process without a terminal.
ASKING = ("BdbQuit", "EOFError")


class TrackFault(Exception):
    """Failure of a tracker that ends its run, with the cause and the place in its code.

    Args:
        cause: what went wrong, in one line.
        kind: invalid answer, failed arithmetic, other exception raised, or process died.
        place: file, line and function of the tracker's code, if known.
        member: index of the affected member of the batch, if known.
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
    """Convert an error raised in a tracker to a fault; ``member`` is the affected member's batch index, if known."""
    if isinstance(error, TrackFault):
        return error
    kind: Kind = "raised"
    if isinstance(error, TrackerFault):
        kind = "answer"
    elif isinstance(error, ArithmeticError):
        kind = "arithmetic"
    return TrackFault(_cause(error), kind, place_of(error), member)


def _cause(error: BaseException) -> str:
    name, text = type(error).__name__, ""
    # ``str`` of an error may itself fail.
    with suppress(Exception):
        text = str(error)
    if not isinstance(error, TrackbenchError):
        # Errors of packages may have many lines.
        text = text.strip().partition("\n")[0]
    text = printable(text)
    if isinstance(error, TrackbenchError | TrackerFault):
        return text or name
    if name in ASKING:
        text += " (a process of its own has no terminal; see --in-process)"
    return f"{name}: {text.strip()}" if text else name


def error_message(error: BaseException) -> dict[str, Any]:
    """Return the protocol message by which a tracker's process reports an error to the bench."""
    if isinstance(error, InputError | InputErrors):
        problems = error.errors if isinstance(error, InputErrors) else [error]
        return {"type": "error", "message": str(error), "input": [[each.message, each.key] for each in problems]}
    fault = fault_of(error)
    return {"type": "error", "message": fault.cause, "kind": fault.kind, "place": fault.place, "member": fault.member}


def reported_error(message: Mapping[str, Any], members: int, name: str) -> InputError | InputErrors | TrackFault:
    """Return the error that a protocol message reports; malformed entries of the message are left out.

    Args:
        message: message of the type ``error``.
        members: number of members of the batch.
        name: name of the tracker, put before the cause.
    """
    match message.get("input"):
        case [[str(), _], *_] as problems:
            errors = [InputError(printable(text), key=key) for text, key in problems]
            return errors[0] if len(errors) == 1 else InputErrors(errors)
    kind: Kind = next((known for known in KINDS if known == message.get("kind")), "raised")
    place, member = message.get("place"), message.get("member")
    return TrackFault(
        name + printable(str(message.get("message"))),
        kind,
        printable(place) if isinstance(place, str) else None,
        member if isinstance(member, int) and 0 <= member < members else None,
    )
