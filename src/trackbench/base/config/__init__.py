"""What every configuration class shares: frozen, no unknown keys, no silent conversions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

Positive = Annotated[float, Field(gt=0)]
#: Standard deviations whose squares, and the ratios of these, double precision can hold, in any unit.
LEAST_SIGMA, LARGEST_SIGMA = 1e-9, 1e9
Sigma = Annotated[float, Field(ge=LEAST_SIGMA, le=LARGEST_SIGMA)]
#: Variances of a state's components.
Variance = Annotated[float, Field(ge=LEAST_SIGMA**2, le=LARGEST_SIGMA**2)]
NonNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(gt=0, le=1)]
Angle = Annotated[float, Field(ge=-360, le=360)]

#: Sensors and trackers are named in dotted paths (``nis.front_radar.mean``), so a name has no dot.
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]

#: Keys and list indices, from the root of a file.
KeyPath = tuple[str | int, ...]

#: The type of the pydantic error that carries a message of our own, word for word.
PROBLEM = "problem"


def problem_error(message: str) -> PydanticCustomError:
    """What a validator raises: the message, word for word."""
    return PydanticCustomError(PROBLEM, "{message}", {"message": message})


def chosen_by(tag: Callable[[Any], str | None], message: str) -> Discriminator:
    """What chooses the member of a union by its tag; ``message``: of a value that has none."""
    return Discriminator(tag, custom_error_type=PROBLEM, custom_error_message=message)


class Problem(NamedTuple):
    """A value that is well-formed but cannot be meant."""

    at: KeyPath
    """Keys and list indices, from the model that reports it."""
    message: str
    """What is wrong and what would be right."""


def reject(model: str, problems: list[Problem]) -> None:
    """Raise all ``problems`` of a model as one pydantic ``ValidationError``; return if there is none."""
    if problems:
        lines = [InitErrorDetails(type=problem_error(item.message), loc=item.at, input=None) for item in problems]
        raise ValidationError.from_exception_data(model, lines)


class Config(BaseModel):
    """Base of the configuration classes: field names are the keys of the scenario file.

    An integer is accepted where a float is meant; text is never turned into a number, and NaN and infinity
    are refused.
    """

    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def problems(self) -> Iterator[Problem]:
        """What is wrong between the fields, each of which is valid by itself."""
        yield from ()

    @model_validator(mode="after")
    def _no_problems(self) -> Self:
        reject(type(self).__name__, list(self.problems()))
        return self


#: Tags of unions. They appear in pydantic's locations, where the brackets tell them from keys.
WORD, MAPPING, NUMBER, LIST = "<word>", "<mapping>", "<number>", "<list>"


def shape(value: Any) -> str | None:
    """The tag of a union of a word and a mapping."""
    if isinstance(value, str):
        return WORD
    return MAPPING if isinstance(value, dict | BaseModel) else None


def number_or_list(value: Any) -> str | None:
    """The tag of a union of a number and a list; text counts as a number, so that the message is about that."""
    if isinstance(value, list):
        return LIST
    return NUMBER if isinstance(value, int | float | str) and not isinstance(value, bool) else None


def text_or_list(value: Any) -> str | None:
    """The tag of a union of a text and a list."""
    return LIST if isinstance(value, list) else WORD if isinstance(value, str) else None
