"""What of a recorded truth counts where tracks are scored, and which point of a box it has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Tag

from trackbench.base.config import LIST, MAPPING, Config, NonNegative, Positive, Problem, chosen_by
from trackbench.truth.jumps import Position

Span = Annotated[list[Position], Field(min_length=2, max_length=2)]


class BoxRegion(Config):
    """A rectangle along the axes of the fixed frame."""

    x_m: Span = Field(description="Least and largest x, m.")
    y_m: Span = Field(description="Least and largest y, m.")

    def problems(self) -> Iterator[Problem]:
        for key in ("x_m", "y_m"):
            low, high = getattr(self, key)
            if low >= high:
                yield Problem((key,), f"must be [low, high] with {low:g} below {high:g}")


def _region_shape(value: Any) -> str | None:
    return LIST if isinstance(value, list) else MAPPING if isinstance(value, dict | BoxRegion) else None


Region = Annotated[
    Annotated[list[Span], Field(min_length=3, max_length=1000), Tag(LIST)] | Annotated[BoxRegion, Tag(MAPPING)],
    chosen_by(
        _region_shape, "write the corners [[x, y], ...] of a polygon, m, or {x_m: [low, high], y_m: [low, high]}"
    ),
]


def _as_text(value: Any) -> Any:
    return f"{value:.17g}" if isinstance(value, int | float) and not isinstance(value, bool) else value


CellValue = Annotated[str, BeforeValidator(_as_text, json_schema_input_type=str | float)]
POINTS = ("centre", "rear_axle", "rear_bumper")


class ReferenceOptions(Config):
    """What of a recorded truth counts, and which point of a box its positions are.

    An object outside the region, out of range or of another class need not be tracked, and a track there is not false:
    neither changes a score. The same holds on a don't-care box.
    """

    point: Literal["centre", "rear_axle", "rear_bumper"] | None = Field(
        None,
        description="Which point of the box the columns px and py are, at half of its width. Required with "
        "columns.length; positions are moved to the centre, along columns.heading.",
    )
    rear_overhang_m: NonNegative | None = Field(
        None, description="Distance from the rear bumper to the rear axle, m; required with point: rear_axle."
    )
    region: Region | None = Field(
        None,
        description="Where objects count, in the fixed frame: the corners [[x, y], ...] of a polygon, m, or {x_m: "
        "[low, high], y_m: [low, high]}. Everywhere unless given.",
    )
    range_m: Positive | None = Field(
        None, description="Distance from the observer up to which objects count, m; without limit unless given."
    )
    classes: list[str] | None = Field(
        None,
        min_length=1,
        description="Classes that count, as they stand in columns.class; all unless given. Objects of others hide what "
        "is behind them.",
    )
    ignore: dict[str, Annotated[list[CellValue], Field(min_length=1)]] = Field(
        default_factory=dict,
        description="By the name of a column of the file, the values that make a row a don't-care box, such as {type: "
        "[DontCare], conf: [0]}. Such a row is of no object; its box counts until half way to the rows before and "
        "after.",
    )

    @property
    def of_tracks(self) -> list[str]:
        """The keys that are given of those that say what counts."""
        return [key for key in ("region", "range_m", "classes", "ignore") if getattr(self, key)]

    def problems(self) -> Iterator[Problem]:
        if self.point == "rear_axle" and self.rear_overhang_m is None:
            message = "missing: the distance from the rear bumper to the rear axle, which the position is"
            yield Problem(("rear_overhang_m",), message)
        if self.point != "rear_axle" and self.rear_overhang_m is not None:
            yield Problem(("rear_overhang_m",), "only used with point: rear_axle; remove")
