"""CommonRoad scenarios, XML of the versions 2018b and 2020a.

Source: CommonRoad, "Documentation of the XML Format", versions 2018b and 2020a.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.files import read_text
from trackbench.truth.tracks import TrafficFormat, TrafficTrack

_MOTION = ("time/exact", "position/point/x", "position/point/y")
#: A document type can name files and entities that grow without end; no scenario has one.
_DOCUMENT_TYPE = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


class CommonRoad(TrafficFormat):
    """CommonRoad scenario, XML of version 2018b or 2020a: the dynamic obstacles with a trajectory."""

    endings: ClassVar[tuple[str, ...]] = (".xml",)

    def read(self, file: Path) -> list[TrafficTrack]:
        text = read_text(file)
        if _DOCUMENT_TYPE.search(text):
            raise InputError("it declares a document type or an entity, which no CommonRoad scenario has", file=file)
        try:
            root = ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            line = error.position[0] if isinstance(error, ElementTree.ParseError) else None
            raise InputError(f"not valid XML: {error}", file=file, line=line) from None
        if root.tag != "commonRoad":
            raise InputError(f"its root is <{root.tag[:40]}>, where <commonRoad> is expected", file=file)
        try:
            step = _number(root.get("timeStepSize"))
            return [track for item in _obstacles(root) if (track := _track(item, step)) is not None]
        except ValueError as error:
            raise InputError(str(error), file=file) from None


def _obstacles(root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    yield from root.iterfind("dynamicObstacle")
    yield from (item for item in root.iterfind("obstacle") if item.findtext("role", "").strip() == "dynamic")


def _track(item: ElementTree.Element, step: float) -> TrafficTrack | None:
    """One obstacle; None where it has a set of occupancies in place of a trajectory."""
    name = (item.get("id") or "").strip()
    states = [*item.iterfind("initialState"), *item.iterfind("trajectory/state")]
    if item.find("trajectory") is None:
        return None
    try:
        rows = [[_number(state.findtext(path)) for path in _MOTION] for state in states]
        own = {key: [state.findtext(f"{key}/exact") for state in states] for key in ("orientation", "velocity")}
        stated = {key: [_number(text) for text in texts] for key, texts in own.items() if None not in texts}
        length, width = (_size(item, key) for key in ("length", "width"))
    except ValueError as error:
        raise ValueError(f"obstacle {name[:20]!r}: {error}") from None
    time, x, y = np.array(rows).T
    heading, speed = (np.array(stated[key]) if key in stated else None for key in ("orientation", "velocity"))
    kind = (item.findtext("type") or "").strip()
    return TrafficTrack(name, time * step, x, y, heading, speed, length, width, kind)


def _size(item: ElementTree.Element, key: str) -> float | None:
    """Of a rectangle, or of a circle its diameter; None of any other shape."""
    rectangle, radius = item.findtext(f"shape/rectangle/{key}"), item.findtext("shape/circle/radius")
    if rectangle is not None:
        return _number(rectangle)
    return None if radius is None else 2 * _number(radius)


def _number(text: str | None) -> float:
    if text is None:
        raise ValueError("a time, position or size is missing; exact values are needed, not intervals")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()[:20]!r} is not a finite number")
    return value
