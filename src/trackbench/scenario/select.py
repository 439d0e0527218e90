"""A scenario with some of its trackers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trackbench.base.errors import InputError, nearest
from trackbench.scenario.load import Scenario


def select_trackers(loaded: Scenario, names: Sequence[str]) -> Scenario:
    """The scenario with some of its trackers, and the expectations that can still be judged.

    Args:
        loaded: the scenario.
        names: of trackers; that of a sweep stands for all of its points.

    Raises:
        InputError: there is no tracker of a name.
    """
    config = loaded.config
    for name in names:
        if name not in config.trackers and name not in loaded.sweeps:
            problem = f"no tracker {name!r} in this scenario; {nearest(name, [*config.trackers, *loaded.sweeps])}"
            raise InputError(problem, key="--trackers", file=loaded.path)
    wanted = {point for name in names for point in loaded.sweeps.get(name, (name,))}
    kept = {name: tracker for name, tracker in config.trackers.items() if name in wanted}
    if not kept:
        raise InputError("name at least one tracker", key="--trackers", file=loaded.path)
    expect = [item for item in config.expect if {item.tracker, item.better_than or item.tracker} <= set(kept)]
    chosen = config.model_copy(update={"trackers": kept, "expect": expect})
    return replace(loaded, config=chosen, selected=tuple(names))
