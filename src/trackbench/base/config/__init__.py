"""Base of all configuration classes: frozen, no unknown keys, no silent conversions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic.fields import FieldInfo

from trackbench.base.config.messages import explain, keyed_fields
from trackbench.base.config.problems import KeyPath, Problem, chosen_by, problem_error, reject

__all__ = ["Config", "KeyPath", "Problem", "chosen_by", "problem_error", "reject"]

Positive = Annotated[float, Field(gt=0)]
#: Limits of a standard deviation: double precision holds the squares and their ratios, in any unit.
LEAST_SIGMA, LARGEST_SIGMA = 1e-9, 1e9
Sigma = Annotated[float, Field(ge=LEAST_SIGMA, le=LARGEST_SIGMA)]
#: Variance of a component of a state.
Variance = Annotated[float, Field(ge=LEAST_SIGMA**2, le=LARGEST_SIGMA**2)]
NonNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(gt=0, le=1)]
Angle = Annotated[float, Field(ge=-360, le=360)]

#: Sensors and trackers are named in dotted paths (``nis.front_radar.mean``), so a name has no dot.
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]


class Config(BaseModel):
    """Base of the configuration classes, whose field names are the keys of the scenario file.

    An integer is accepted for a float. Text is never turned into a number; NaN and infinity are refused.
    """

    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def problems(self) -> Iterator[Problem]:
        """Yield the contradictions between fields that are each valid alone."""
        yield from ()

    @classmethod
    def keys_of(cls, data: Any) -> Mapping[str, FieldInfo]:
        """Return the fields of this class that the mapping ``data`` of a file may set, by their keys in the file."""
        return keyed_fields(cls)

    @classmethod
    def located(cls, path: KeyPath, data: Any) -> KeyPath:
        """Return the path in the file of the invalid value that pydantic reports at ``path`` of this class."""
        return path

    @model_validator(mode="wrap")
    @classmethod
    def _explained(cls, data: Any, validate: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            made = validate(data)
        except ValidationError as invalid:
            problems = explain(invalid, cls.keys_of(data))
            reject(cls.__name__, [Problem(cls.located(item.at, data), item.message) for item in problems])
            raise
        reject(cls.__name__, made.problems())
        return made


#: Tags of the members of unions. Pydantic puts tags into its locations, where the brackets tell tags from keys.
WORD, MAPPING, NUMBER, LIST = "<word>", "<mapping>", "<number>", "<list>"


def shape(value: Any) -> str | None:
    """Return the tag ``<word>`` or ``<mapping>`` of a value, for a field that accepts both; None for another value."""
    if isinstance(value, str):
        return WORD
    return MAPPING if isinstance(value, dict | BaseModel) else None


def number_or_list(value: Any) -> str | None:
    """Return the tag of a number or a list, else None; text counts as a number, so that a message asks for a number."""
    if isinstance(value, list):
        return LIST
    return NUMBER if isinstance(value, int | float | str) and not isinstance(value, bool) else None


def text_or_list(value: Any) -> str | None:
    """Return the tag of a text or a list, for a field that accepts both; None for another value."""
    return LIST if isinstance(value, list) else WORD if isinstance(value, str) else None
