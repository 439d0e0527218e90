"""An effect of a user's own that returns what it must not is named, with its method and what that must return."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import trackbench as tb
from trackbench.base.errors import TrackbenchError
from trackbench.base.plugins import Registry
from trackbench.models.sensors.effects import EFFECTS

SCENARIO = """\
name: odd
truth: {source: scripted, duration_s: 1, rate_hz: 10, objects: {car: {start: {x: 20, y: 5, speed_mps: 10}}}}
sensing: {identities: %s}
sensors: {lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, effects: [{type: "%s:Odd"}]}}
trackers: {mine: {%s}}
score: {%s}
monte_carlo: {runs: 2, seed: 7}
"""
MODULE = """\
import numpy as np
from trackbench.models.sensors.effects import Effect

class Odd(Effect):
    "Is odd."
    def %s
        return %s
"""
BEFORE, AFTER, ALARMS = (
    "before(self, sensed, random):",
    "after(self, measurement, sensor):",
    "alarms(self, sensed, random):",
)
#: By what a method returns, the end of the message.
WRONG = [
    (BEFORE, "None", "what before returns must be a Sensed, as by sensed.replaced(...), not None"),
    (
        BEFORE,
        "sensed.replaced(error=np.zeros(3))",
        "error of what before returns must be an array of numbers of shape (2, 11, 1, 2), not one of shape (3,)",
    ),
    (
        BEFORE,
        "sensed.replaced(probability=sensed.probability * np.nan)",
        "probability of what before returns must be finite, not nan",
    ),
    (AFTER, "None", "what after returns must be an array of numbers of shape (2, 11, 1, 2), not None"),
    (ALARMS, "np.arange(3)", "None, or the numbers of runs (n,) and of instants (n,) and measurements (2, n)"),
    (
        ALARMS,
        "*np.zeros((2, 3), int), np.zeros((2, 4))",
        "the measurements of what alarms returns must be an array of numbers of shape (2, 3), not one of shape (2, 4)",
    ),
    (
        ALARMS,
        "np.array([0]), np.array([99]), np.zeros((2, 1))",
        "the instants of what alarms returns must be whole numbers from 0 to 10, not [99]",
    ),
]


@pytest.mark.parametrize(("method", "returned", "message"), WRONG)
def test_a_wrong_answer_is_said_with_its_method(
    tmp_path: Path, write_module: Callable[..., str], method: str, returned: str, message: str
) -> None:
    module = write_module(tmp_path, MODULE % (method, returned))
    hidden = method == ALARMS
    file = tmp_path / "odd.yaml"
    tracker = "filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}" if hidden else "use: raw"
    file.write_text(
        SCENARIO % ("hidden" if hidden else "known", module, tracker, "" if hidden else "settle_s: 0"), encoding="utf-8"
    )
    with pytest.raises(TrackbenchError) as error:
        tb.run(file)
    assert f"effect '{module}:Odd': " in str(error.value)
    assert message in str(error.value)


def test_an_effect_that_does_nothing_is_refused(tmp_path: Path, write_module: Callable[..., str]) -> None:
    module = write_module(tmp_path, "from trackbench.models.sensors.effects import Effect\nclass Odd(Effect): pass\n")
    registry: Registry[Any] = EFFECTS
    with pytest.raises(TrackbenchError, match="is no sensor effect: it has no method before, after or alarms"):
        registry.get(f"{module}:Odd", tmp_path)
    assert not EFFECTS.failures()
