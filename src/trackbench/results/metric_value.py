"""Metric value as a result holds it: number, unit, interval and verdicts, by dotted path."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.files import read_bytes

Json = dict[str, Any]
K = TypeVar("K")
M = TypeVar("M", bound=BaseModel)
#: Relative difference of two values that is attributed to rounding, which differs between engines.
ROUNDING = 1e-9


class ResultModel(BaseModel):
    """Base of every part of a result: a frozen pydantic model that refuses unknown keys."""

    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", allow_inf_nan=False)


def model_of(kind: type[M], raw: Any, file: Path, what: str, version: int) -> M:
    """Validate the values of a JSON file as a model of one kind.

    Args:
        kind: type of the model.
        raw: values of the file.
        file: name of the file, for error messages.
        what: noun that names such a model in error messages.
        version: expected version of the schema.

    Raises:
        InputError: the values are not such a model, or of another version.
    """
    required = {name for name, field in kind.model_fields.items() if field.is_required()}
    if not isinstance(raw, dict) or "schema_version" not in raw or (len(raw) > 1 and required.isdisjoint(raw)):
        raise InputError(f"not a {what}", file=file)
    if raw["schema_version"] != version:
        other = f"this {what} was written by another version of trackbench; make it again"
        raise InputError(f"schema_version is not {version}: {other}", file=file)
    try:
        return kind.model_validate({key: raw[key] for key in raw if key != "passed" or key in kind.model_fields})
    except ValidationError as invalid:
        error = invalid.errors()[0]
        where = ".".join(map(str, error["loc"]))
        raise InputError(f"not a {what}: {where}: {error['msg']}", file=file) from None


def read_model(kind: type[M], file: Path, what: str, version: int) -> M:
    """Read a JSON file and validate its values as a model of one kind.

    Raises:
        InputError: the file cannot be read, or is not such a model.
    """
    try:
        raw = json.loads(read_bytes(file))
    except FileNotFoundError:
        raise InputError("there is no such file", file=file) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a readable {what}: {error}", file=file) from error
    return model_of(kind, raw, file, what, version)


def data_frame(rows: Iterable[Mapping[str, Any]]) -> Any:
    """Return a pandas data frame of rows with the same keys."""
    import pyarrow as pa

    return pa.Table.from_pylist([dict(row) for row in rows]).to_pandas()


class PartVerdict(ResultModel):
    """Verdict on the tails of the NEES, or on the NEES along or across the motion."""

    name: str
    """Part that the verdict is about, such as ``beyond the 95 % point`` or ``along the motion``."""
    value: float
    """Share of NEES beyond the point of chi-square, or mean NEES along or across the motion."""
    expected: float
    """Value expected of a tracker whose covariance is right."""
    ci95: tuple[float, float]
    verdict: str


class ConditionVerdict(ResultModel):
    """Mean NEES under one condition, with the verdict on the covariance."""

    name: str
    """Name of the condition: a manoeuvre, a range band, ``first second``, or for the NEES of two components over all
    estimates ``position alone`` or ``velocity alone``."""
    mean: float
    ci95: tuple[float, float]
    verdict: str
    parts: tuple[PartVerdict, ...] = ()
    """Verdicts on the tails of the NEES and on the NEES along and across the motion, under this condition; empty where
    estimates are too few."""


class MetricValue(ResultModel):
    """Metric value with its unit and confidence interval; for a NEES or NIS also degrees of freedom and a verdict.

    It is a number: ``float(value)``, ``f"{value:.3f}"`` and ``value < 0.1`` work; without a value they raise an
    InputError with the reason. ``str`` gives value and interval, "0.0971 m (0.090 to 0.118)", or "no value: ...".
    """

    value: float | None = None
    """Value of the metric; None where it is missing, with the cause in ``reason``. In JSON the value of a NEES or NIS
    is named ``mean``."""
    unit: str
    """Unit of the value; "1" for a number without one."""
    ci95: tuple[float, float] | None = None
    """95 % interval; None where a single run cannot give an interval, or the metric never has one."""
    reason: str | None = None
    """Reason for a missing value or interval; None where nothing is missing or no reason is known."""
    dof: int | None = None
    """Degrees of freedom of a NEES or NIS, the mean expected of a consistent tracker; None for other metrics."""
    steps_inside_bounds: float | None = None
    """Share of instants at which the NEES or NIS, averaged over runs and objects, is within its 95 % bounds; None for
    other metrics."""
    coverage: float | None = None
    """Share of the innovations that were given, among the measurements that should have one; None unless a NIS."""
    inside95: float | None = None
    """Share of single NIS values below the 95 % point of chi-square; None for other metrics."""
    verdict: str | None = None
    """Verdict: on a covariance, such as ``consistent``, or on the whiteness of innovations, such as ``white``. None for
    other metrics."""
    also: str | None = None
    """``heavy-tailed`` where large errors are too frequent although ``verdict``, by the mean, does not say so; else
    None."""
    words: str | None = None
    """Verdict on a covariance in plain words, such as "too large; about right on straights"; None for other metrics."""
    charged_share: float | None = None
    """Share of the squared error that is charged for missing estimates; None where no estimate is missing."""
    without_charged: float | None = None
    """Value over the estimates that the tracker gave, without charges for missing estimates; None where no estimate is
    missing."""
    p05: float | None = None
    """5 % quantile of the delays, s, of a driver assistance function against the truth; ``p50`` and ``p95`` likewise.
    None for other metrics."""
    p50: float | None = None
    p95: float | None = None
    early: float | None = None
    """Mean of the delays below 0 of a driver assistance function, s; None where no delay is below 0."""
    late: float | None = None
    """Mean of the delays above 0 of a driver assistance function, s; None where no delay is above 0."""
    missing: float | None = None
    """Share of the events to which a driver assistance function did not react; None for other metrics."""
    conditions: tuple[ConditionVerdict, ...] | None = None
    """Verdict under each condition, such as a manoeuvre, from which the ``verdict`` on a NEES is combined; None for
    other metrics."""
    parts: tuple[PartVerdict, ...] | None = None
    """Verdicts on the tails of the NEES and on its directions, over all estimates, from which ``verdict`` is combined;
    None for other metrics."""

    @property
    def mean(self) -> float | None:
        """Value of a metric that is a mean; another name for ``value``."""
        return self.value

    def __float__(self) -> float:
        if self.value is None:
            raise InputError(f"there is no value: {self.reason or 'none was computed'}")
        return self.value

    def __lt__(self, other: float | MetricValue) -> bool:
        return float(self) < float(other)

    def __le__(self, other: float | MetricValue) -> bool:
        return float(self) <= float(other)

    def __gt__(self, other: float | MetricValue) -> bool:
        return float(self) > float(other)

    def __ge__(self, other: float | MetricValue) -> bool:
        return float(self) >= float(other)

    def __format__(self, spec: str) -> str:
        return format(float(self), spec) if spec else str(self)

    def __str__(self) -> str:
        if self.value is None:
            return f"no value: {self.reason or 'none was computed'}"
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.ci95 is None or not self.ci95[0] < self.ci95[1]:
            return f"{self.value:.4g}{unit}"
        low, high = self.ci95
        # The ends show two significant digits of the width, the value one more.
        places = max(0, 1 - math.floor(math.log10(high - low)))
        return f"{self.value:.{places + 1}f}{unit} ({low:.{places}f} to {high:.{places}f})"

    def __repr__(self) -> str:
        return f"<{self}>"

    @model_validator(mode="before")
    @classmethod
    def _from_mean(cls, data: Any) -> Any:
        if isinstance(data, dict) and "mean" in data and "value" not in data:
            return {**{key: value for key, value in data.items() if key != "mean"}, "value": data["mean"]}
        return data

    @model_serializer(mode="wrap")
    def _short(self, handler: SerializerFunctionWrapHandler) -> Json:
        """Return the JSON without unset fields, but with the value, and the interval where ``reason`` explains it."""
        entry = {key: value for key, value in handler(self).items() if value is not None}
        value = entry.pop("value", None)
        if value is not None and self.reason is not None:
            entry["ci95"] = None
        return {"mean" if self.dof is not None else "value": value, **entry}


class MetricsByPath(dict[str, MetricValue]):
    """Metrics of a tracker by dotted path; an unknown path raises an InputError."""

    def __missing__(self, path: str) -> MetricValue:
        raise InputError(f"no metric {path!r} of this tracker; {nearest_choices(str(path), self)}")


Metrics = Annotated[dict[str, MetricValue], AfterValidator(MetricsByPath)]


def by_value(values: Mapping[K, float]) -> list[K]:
    """Return the keys by their values, smallest value first; values equal up to rounding keep their order."""
    least: dict[K, float] = {}
    value = first = math.nan
    for key in sorted(values, key=values.__getitem__):
        first = first if math.isclose(values[key], value, rel_tol=ROUNDING) else values[key]
        least[key], value = first, values[key]
    return sorted(values, key=least.__getitem__)
