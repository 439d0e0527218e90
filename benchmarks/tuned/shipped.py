"""The shipped scenarios with the values of their family."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from trackbench.subjects.tuning.entry import plain

from .protocol import SCENARIOS, Protocol

#: Where the trackers of a scenario begin and end.
BEGIN, END = "# Every tracker is tuned alike", "\nmonte_carlo:"


def update(protocol: Protocol, values: Mapping[str, Any]) -> None:
    """Write them."""
    for scenario in protocol.scenarios:
        file = SCENARIOS / f"{scenario}.yaml"
        file.write_text(tuned_text(protocol, values, scenario), encoding="utf-8")


def tuned_text(protocol: Protocol, values: Mapping[str, Any], scenario: str) -> str:
    """The text of a scenario whose trackers have the values of its family, to two digits."""
    family = protocol.family_of(scenario)
    entries = protocol.entries
    loaded = protocol.loaded(scenario, entries)
    tuned = {
        tracker: plain(loaded, tracker, {key: _rounded(value) for key, value in values[tracker][family].items()})
        for tracker in entries
    }
    trackers = {"trackers": {"raw": {"use": "raw"}, **tuned}}
    text = (SCENARIOS / f"{scenario}.yaml").read_text(encoding="utf-8")
    before, _, after = text.partition(BEGIN)
    heading = f'{BEGIN}, with one set of values for the scenarios of "{family}": results/tuned/tuned.md.\n'
    shown = yaml.safe_dump(trackers, sort_keys=False, default_flow_style=None, width=120)
    return before + heading + shown + END + after.partition(END)[2]


def _rounded(value: float) -> float | int:
    """To two digits."""
    short = float(f"{value:.2g}")
    return int(short) if short.is_integer() else short
