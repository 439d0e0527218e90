"""The task of an envelope: axes, requirements, looks and the scenario's own point, from the ``envelope:`` block."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel

from trackbench.base.errors import InputError
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of, select_trackers
from trackbench.scenario.truth import truth_source
from trackbench.scenario.worlds import RECORDED_HZ
from trackbench.subjects.envelope.axes import MapAxis, Point, Value, axes_of, overrides
from trackbench.subjects.envelope.cells import Extent, requirements_of
from trackbench.subjects.envelope.claim import AbsentCells, ClaimedLimit
from trackbench.subjects.envelope.config import EnvelopeConfig, axis_keys
from trackbench.truth.config.traffic import TracksConfig


def changed_scenario(loaded: Scenario, changes: Sequence[str], trackers: Sequence[str]) -> Scenario:
    """Return the scenario with ``key.path=value`` changes, and with only some of its trackers."""
    return select_trackers(scenario_of(loaded.text, loaded.path, [*loaded.overrides, *changes]), trackers)


def base_point(loaded: Scenario, axes: Sequence[MapAxis]) -> list[Value | None]:
    """Return the scenario's own value of each axis; None where it has none, or where linked keys contradict each other.

    On an axis of worlds (drivers and sensors) a scenario that names no world is at the first world of the axis.
    """
    return [_own_value(loaded, axis) for axis in axes]


def _own_value(loaded: Scenario, axis: MapAxis) -> Value | None:
    config = axis.config
    if config.form == "choices":
        first = axis.values[0] if config.key == "world" and loaded.config.world is None else None
        return next((value for value in axis.values if _is_set(loaded, axis.changes(value))), first)
    numbers = []
    for key, link in axis.links.items():
        number = value_at(loaded, key)
        if isinstance(number, bool) or not isinstance(number, int | float):
            return None
        numbers.append(link.value(number))
    agree = bool(numbers) and max(numbers) - min(numbers) <= 1e-9 * max(map(abs, numbers))
    # Rounded, since the keys are linked by rounded factors.
    return float(f"{numbers[0]:.12g}") if agree else None


def _is_set(loaded: Scenario, changes: Mapping[str, Any]) -> bool:
    return all(value_at(loaded, key) == value for key, value in changes.items())


def value_at(loaded: Scenario, key: str) -> Any:
    """Return the value at a dotted key: as written, else its default; None where there is neither."""
    parts = key.split(".")
    written = _walk(loaded.document.value, parts)
    return _walk(loaded.config, parts) if written is None else written


def _walk(node: Any, parts: Sequence[str]) -> Any:
    for part in parts:
        if isinstance(node, Mapping):
            node = node.get(part)
        elif isinstance(node, list):
            node = node[int(part)] if part.isdecimal() and int(part) < len(node) else None
        elif isinstance(node, BaseModel):
            fields = type(node).model_fields
            name = next((name for name, field in fields.items() if part in (name, field.alias)), part)
            node = getattr(node, name, None)
        else:
            return None
    return node


def _may_be_set_by_world(key: str) -> bool:
    # ``truth.seeds`` is the number of scenes in every world.
    return key.partition(".")[0] in ("truth", "sensors") and key != "truth.seeds"


class EnvelopeTask(NamedTuple):
    """Task of an envelope: the scenario with its axes, requirements and looks."""

    loaded: Scenario
    """Scenario with only the trackers that have a requirement."""
    config: EnvelopeConfig
    axes: tuple[MapAxis, ...]
    requirements: tuple[ClaimedLimit, ...]
    extents: tuple[Extent, ...]
    """Numbers of scenes and of runs of each scene of a cell at each look (interim test), cumulative."""

    @property
    def base(self) -> list[Value | None]:
        """The scenario's own value on each axis; None for an axis on which the scenario has no value."""
        return base_point(self.loaded, self.axes)

    @property
    def trackers(self) -> list[str]:
        """Names of the trackers that have a requirement."""
        return list(dict.fromkeys(item.tracker for item in self.requirements))

    def requirements_on(self, tracker: str) -> list[ClaimedLimit]:
        return [item for item in self.requirements if item.tracker == tracker]

    def scenario_at(self, point: Point) -> Scenario:
        """Return the scenario of a cell, with the number of runs of the last look.

        Raises:
            InputError: the scenario is invalid at the point; the message has the values of the axes.
        """
        last = self.extents[-1]
        changes = [*overrides(self.axes, point), f"monte_carlo.runs={last.runs}"]
        changes += [f"truth.seeds={last.scenes}"] if self.config.claim == "traffic like these" else []
        try:
            return changed_scenario(self.loaded, changes, [*self.loaded.config.trackers])
        except InputError as error:
            at = ", ".join(f"{axis.name} {value}" for axis, value in zip(self.axes, point, strict=True))
            message = f"{error.key} at {at}: {error.message}"
            raise self.loaded.locate(InputError(message, key="envelope.axes")) from error

    def absent_at(self, point: Point) -> AbsentCells | None:
        """Return the group of absent cells that a point belongs to; None where the point is a cell of its own.

        A cell is absent where the world sets the key that an axis varies, so that it would be a copy of another cell.

        Raises:
            InputError: the scenario is invalid at the point; the message has the values of the axes.
        """
        loaded = self.scenario_at(point)
        if loaded.config.world != "recorded":
            return None
        at = [*zip(self.axes, point, strict=True)]
        worlds = {axis.name: value for axis, value in at if "world" in axis.changes(value)}
        for axis, value in at:
            for key, number in axis.changes(value).items():
                if _may_be_set_by_world(key) and _walk(loaded.document.value, key.split(".")) != number:
                    why = f"recorded at {RECORDED_HZ} Hz" if key.startswith("sensors.") else "the truth is recorded"
                    return AbsentCells(at=worlds | {axis.name: value}, reason=why)
        return None


def task_of(loaded: Scenario) -> EnvelopeTask:
    """Return the task of the scenario's ``envelope:`` block.

    Raises:
        InputError: the scenario has no such block or no requirement, or its scenes cannot repeat as the claim needs.
    """
    config: EnvelopeConfig | None = getattr(loaded.config, "envelope", None)
    if config is None:
        message = "missing: nothing says what is varied; write envelope: {axes: {NAME: {key: ..., from: ..., to: ...}}}"
        raise InputError(message, key="envelope", file=loaded.path)
    requirements = requirements_of(loaded)
    needed = {item.tracker for item in requirements}
    chosen = select_trackers(loaded, [name for name in loaded.config.trackers if name in needed])
    for name, entry in chosen.config.trackers.items():
        if isinstance(entry, TracksConfig):
            message = "its tracks were made elsewhere, and there are none for other cells"
            raise loaded.locate(InputError(message, key=f"trackers.{name}.use"))
    return EnvelopeTask(chosen, config, axes_of(config), tuple(requirements), _extents(chosen, config))


def truth_key(loaded: Scenario) -> str:
    """Return a key that is equal for scenarios with the same ground truth."""
    config = loaded.config
    hidden = config.sensing.identities
    return json.dumps([hidden, config.monte_carlo.seed, repr(truth_source(loaded)), config.monte_carlo.runs])


def _extents(loaded: Scenario, config: EnvelopeConfig) -> tuple[Extent, ...]:
    """Return the numbers of scenes and runs at each look; runs, or scenes for a claim on traffic, double to a limit."""
    sizes = [config.runs.first]
    while sizes[-1] < config.runs.most:
        sizes.append(min(2 * sizes[-1], config.runs.most))
    scenes = len(loaded.config.truth.scenes())
    if config.claim == "these scenes":
        return tuple(Extent(scenes, size) for size in sizes)
    varied = {key for axis in config.axes.values() for key in axis_keys(axis)}
    if "seeds" not in type(loaded.config.truth).model_fields or "truth.seeds" in varied:
        message = "traffic like these needs scenes that repeat, a truth with seeds; write these scenes"
        raise loaded.locate(InputError(message, key="envelope.claim"))
    return tuple(Extent(size, loaded.config.monte_carlo.runs) for size in sizes)
