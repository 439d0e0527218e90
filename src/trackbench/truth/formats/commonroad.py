"""CommonRoad scenarios, XML of the versions 2018b and 2020a.

Source: CommonRoad, "Documentation of the XML Format", versions 2018b and 2020a.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.files import read_text
from trackbench.base.numbers import stated_number
from trackbench.truth.tracks import TrackRows, TrafficFormat


class CommonRoad(TrafficFormat):
    """CommonRoad scenario, XML of version 2018b or 2020a: the dynamic obstacles with a trajectory."""

    endings: ClassVar[tuple[str, ...]] = (".xml",)

    def rows(self, file: Path) -> TrackRows:
        try:
            root = ElementTree.fromstring(read_text(file))
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            line = error.position[0] if isinstance(error, ElementTree.ParseError) else None
            raise InputError(f"not valid XML: {error}", file=file, line=line) from None
        if root.tag != "commonRoad":
            raise InputError(f"its root is <{root.tag[:40]}>, where <commonRoad> is expected", file=file)
        try:
            step = _number(root.get("timeStepSize"))
            rows = [row for item in _obstacles(root) for row in _rows(item)]
        except ValueError as error:
            raise InputError(str(error), file=file) from None
        if not rows:
            raise InputError("there is no vehicle in this file", file=file)
        names, kinds, numbers = zip(*rows, strict=True)
        time, x, y, heading, speed, length, width = np.array(numbers).T
        sizes = {"length": length, "width": width}
        return TrackRows(names, time * step, x, y, heading=heading, speed=speed, **sizes, kind=kinds)


def _obstacles(root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    yield from root.iterfind("dynamicObstacle")
    yield from (item for item in root.iterfind("obstacle") if item.findtext("role", "").strip() == "dynamic")


def _rows(item: ElementTree.Element) -> Iterator[tuple[str, str, tuple[float, ...]]]:
    """Yield name, class and row (time, position, motion, size) of each state of an obstacle that has a trajectory."""
    name, kind = (item.get("id") or "").strip(), (item.findtext("type") or "").strip()
    if item.find("trajectory") is None:
        return
    states = [*item.iterfind("initialState"), *item.iterfind("trajectory/state")]
    try:
        # A shape that is neither a rectangle nor a circle has no size.
        diameter = 2 * _number(item.findtext("shape/circle/radius", "0"))
        size = [_number(item.findtext(f"shape/rectangle/{key}", str(diameter))) for key in ("length", "width")]
        for state in states:
            motion = [_number(state.findtext(path)) for path in ("time/exact", "position/point/x", "position/point/y")]
            texts = (state.findtext(f"{key}/exact") for key in ("orientation", "velocity"))
            yield name, kind, (*motion, *(math.nan if text is None else _number(text) for text in texts), *size)
    except ValueError as error:
        raise ValueError(f"obstacle {name[:20]!r}: {error}") from None


def _number(text: str | None) -> float:
    if text is None:
        raise ValueError("a time, position or size is missing; exact values are needed, not intervals")
    value = stated_number(text.strip())
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()[:20]!r} is not a finite number")
    return value
