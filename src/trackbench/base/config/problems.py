"""What is wrong with a configuration: a key path and a message."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from pydantic import Discriminator, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

#: Keys and list indices, from the root of a file.
KeyPath = tuple[str | int, ...]

#: The type of the pydantic error that carries a message of our own, word for word.
PROBLEM = "problem"


class Problem(NamedTuple):
    """A value that cannot be meant."""

    at: KeyPath
    """Keys and list indices, from the model that reports it."""
    message: str
    """What is wrong and what would be right."""


def problem_error(message: str) -> PydanticCustomError:
    """Return what a validator raises: the message, word for word."""
    return PydanticCustomError(PROBLEM, "{message}", {"message": message})


def reject(model: str, problems: Iterable[Problem]) -> None:
    """Raise all ``problems`` of a model as one pydantic ``ValidationError``; return if there is none."""
    lines = [InitErrorDetails(type=problem_error(item.message), loc=item.at, input=None) for item in problems]
    if lines:
        raise ValidationError.from_exception_data(model, lines)


def chosen_by(tag: Callable[[Any], str | None], message: str) -> Discriminator:
    """Return what chooses the member of a union by its tag.

    Args:
        tag: from a value to the tag, which is in angle brackets; None for a value of no member.
        message: what is said of a value of no member.
    """
    return Discriminator(tag, custom_error_type=PROBLEM, custom_error_message=message)
