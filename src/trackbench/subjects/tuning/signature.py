"""What determines the trials of a search, and in what two searches differ."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from trackbench.subjects.tuning.entry import plain, source_of
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.measures import WORDS, Sums
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.trackers.config import PluginConfig

#: Results that differ by less, relative to themselves, are those of another processor.
ROUNDING = 1e-9
#: Most differences that are told.
MOST = 3
#: The part of a signature that follows from all others, unless a file or a program changed.
START = "start"


def signature_of(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> dict[str, Any]:
    """What determines the trials of a tracker, as JSON.

    Args:
        tracker: its name.
        objective: name of what it is tuned for.
        parameters: what is tuned.
        seed: of the search.
        train: the scenarios.
        start: what the tracker gives as it is in each. It tells of a changed log, plug-in or program.
    """
    return {
        "objective": objective,
        "seed": seed,
        "ranges": {item.key: item.as_json() for item in parameters},
        "scenarios": {bench.name: _settings(bench, tracker) for bench in train},
        START: {
            bench.name: {name: value for name in sums.units if math.isfinite(value := sums.value(name))}
            for bench, sums in zip(train, start, strict=True)
        },
    }


def differences(kept: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In what two signatures differ, in words; empty where they do not."""
    told = list(_told(*({key: value for key, value in each.items() if key != START} for each in (kept, now))))
    if told:
        more = f" and {len(told) - MOST} more" if len(told) > MOST else ""
        return "; ".join(told[:MOST]) + more
    for name, measures in now[START].items():
        for measure, value in measures.items():
            before = kept.get(START, {}).get(name, {}).get(measure, math.nan)
            if not _same(before, value):
                return (
                    f"in {name} the start now gives {WORDS[measure]} {value:.6g}, and gave {before:.6g}: its code, the "
                    "measurements or trackbench changed"
                )
    return ""


def _settings(bench: Bench, tracker: str) -> dict[str, Any]:
    """Of a scenario what one tracker's trials depend on."""
    config, document = bench.scenario.config, bench.scenario.document.value
    entry = config.trackers[tracker]
    return {
        **{key: value for key, value in document.items() if key not in ("trackers", "expect")},
        "truth": config.truth.model_dump(mode="json", fallback=str),
        "monte_carlo": config.monte_carlo.model_dump(mode="json"),
        "tracker": plain(bench.scenario, tracker),
        "module": _digest(entry.use, bench.scenario.path.resolve().parent) if isinstance(entry, PluginConfig) else "",
    }


def _digest(use: str, folder: Path) -> str:
    """Of the source of a tracker beside the scenario; empty where it is another one."""
    source = source_of(use, folder)
    return hashlib.sha256(source.read_bytes()).hexdigest()[:12] if source is not None else ""


def _told(kept: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Each value that differs."""
    before, after = dict(_leaves(kept, "")), dict(_leaves(now, ""))
    for key in {**after, **before}:
        old, new = before.get(key, "not given"), after.get(key, "not given")
        if not _same(old, new):
            yield f"{key} was {old} and is {new}"


def _leaves(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """The values that are neither mapping nor list, each with its dotted key."""
    if isinstance(node, Mapping):
        parts = list(node.items())
    elif isinstance(node, list | tuple):
        parts = list(enumerate(node))
    else:
        yield path, node
        return
    for key, value in parts:
        yield from _leaves(value, f"{path}.{key}" if path else str(key))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=ROUNDING)
    return bool(one == other)
