"""Settings that determine the trials of a search, by which a stored study is accepted or refused."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from trackbench.subjects.tuning.entry import plain
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.parameters import Parameter

#: Relative difference of results up to which another processor may have made them.
ROUNDING = 1e-9
#: Most differences that a message lists.
MOST = 3


def study_signature(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> dict[str, Any]:
    """Return what determines the trials of a tracker, as JSON gives it back.

    Args:
        tracker: its name.
        objective: name of what it is tuned for.
        parameters: what is tuned.
        seed: of the search.
        train: the scenarios.
        start: what the tracker gives before it is tuned, by scenario.
    """
    signature = {
        "objective": objective,
        "seed": seed,
        "ranges": {item.key: item.as_json() for item in parameters},
        "scenarios": {bench.name: _settings(bench, tracker) for bench in train},
        # It tells of a changed log, plug-in or program.
        "start": {
            bench.name: {name: value for name in sums.measures if math.isfinite(value := sums.value(name))}
            for bench, sums in zip(train, start, strict=True)
        },
    }
    decoded: dict[str, Any] = json.loads(json.dumps(signature))
    return decoded


def setting_differences(stored: Mapping[str, Any], current: Mapping[str, Any]) -> str:
    """Return the differences of two signatures in words; empty where there are none."""
    before, after = dict(_leaves(stored, "")), dict(_leaves(current, ""))
    pairs = {key: (before.get(key, "not given"), after.get(key, "not given")) for key in {**after, **before}}
    changes = [f"{key} was {old} and is {new}" for key, (old, new) in pairs.items() if not _same(old, new)]
    more = f" and {len(changes) - MOST} more" if len(changes) > MOST else ""
    return "; ".join(changes[:MOST]) + more


def _settings(bench: Bench, tracker: str) -> dict[str, Any]:
    """Return the settings of a scenario that the trials of a tracker depend on."""
    config, document = bench.scenario.config, bench.scenario.document.value
    return {
        **{key: value for key, value in document.items() if key not in ("trackers", "expect")},
        "truth": config.truth.model_dump(mode="json", fallback=str),
        "monte_carlo": config.monte_carlo.model_dump(mode="json"),
        "tracker": plain(bench.scenario, tracker),
    }


def _leaves(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield each value that is neither mapping nor list, with its dotted key."""
    if isinstance(node, Mapping):
        parts = [*node.items()]
    elif isinstance(node, list | tuple):
        parts = [*enumerate(node)]
    else:
        yield path, node
        return
    for key, value in parts:
        yield from _leaves(value, f"{path}.{key}" if path else str(key))


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=ROUNDING)
    return bool(first == second)
