"""Problems of a configuration: a key path and a message each."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from pydantic import Discriminator, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

#: Keys and list indices that lead to a value.
KeyPath = tuple[str | int, ...]

#: Type of the pydantic error that carries a message of trackbench word for word.
PROBLEM = "problem"


class Problem(NamedTuple):
    """Invalid value in a configuration, with its key path and a message."""

    at: KeyPath
    """Path to the value: keys and list indices, from the configuration class that reports the problem."""
    message: str
    """Description of the fault and of a valid value."""


def problem_error(message: str) -> PydanticCustomError:
    """Return a pydantic error with this message, for a validator to raise."""
    return PydanticCustomError(PROBLEM, "{message}", {"message": message})


def reject(model: str, problems: Iterable[Problem]) -> None:
    """Raise all ``problems`` of the configuration class ``model`` as one ``ValidationError``, if there are any."""
    lines = [InitErrorDetails(type=problem_error(item.message), loc=item.at, input=None) for item in problems]
    if lines:
        raise ValidationError.from_exception_data(model, lines)


def chosen_by(tag: Callable[[Any], str | None], message: str) -> Discriminator:
    """Return a pydantic discriminator that chooses the member of a union by a tag.

    Args:
        tag: function from a value to its tag in angle brackets; None for a value of no member.
        message: message about a value of no member.
    """
    return Discriminator(tag, custom_error_type=PROBLEM, custom_error_message=message)
