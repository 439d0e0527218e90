"""Name of the study that keeps the trials of a search: another for each setting that determines them."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from typing import Any

from trackbench.subjects.tuning.entry import plain
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.parameters import Parameter

#: Significant digits of the start's results: fewer than the last bits, in which processors differ.
DIGITS = 6


def study_name(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> str:
    """Return the name of the study of a tracker: equal for searches that make the same trials.

    Args:
        tracker: its name.
        objective: name of what it is tuned for.
        parameters: what is tuned.
        seed: of the search.
        train: the scenarios.
        start: what the tracker gives before it is tuned, by scenario; it tells of a changed log, plug-in or program.
    """
    settings = {
        "objective": objective,
        "seed": seed,
        "ranges": [item.as_json() for item in parameters],
        "scenarios": [_settings(bench, tracker) for bench in train],
        "start": [
            {name: f"{value:.{DIGITS}g}" for name in sums.measures if math.isfinite(value := sums.value(name))}
            for sums in start
        ],
    }
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
    return f"{tracker} {digest[:16]}"


def _settings(bench: Bench, tracker: str) -> dict[str, Any]:
    """Return the settings of a scenario that the trials of a tracker depend on."""
    config, document = bench.scenario.config, bench.scenario.document.value
    return {
        **{key: value for key, value in document.items() if key not in ("trackers", "expect")},
        "truth": config.truth.model_dump(mode="json", fallback=str),
        "monte_carlo": config.monte_carlo.model_dump(mode="json"),
        "tracker": plain(bench.scenario, tracker),
    }
