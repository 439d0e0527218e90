"""A latency changes no score, and whoever states one is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.conftest import Outcome, Run

NOTE = "changes no score: measurements come in the order in which they were taken"


def test_no_score_depends_on_it(run_tiny: Run) -> None:
    prompt, late = (run_tiny(f"sensors.radar.latency_s={seconds}") for seconds in (0, 0.5))
    of_prompt, of_late = (result.json()["trackers"] for result in (prompt, late))
    for one, other in zip(of_prompt, of_late, strict=True):
        for tracker in (one, other):
            tracker["metrics"].pop("step_time")
        assert one == other


@pytest.mark.parametrize("command", [["check"], ["run", "--quiet", "--no-recording", "--out", "results"]])
def test_whoever_states_one_is_told(command: list[str], tiny: Path, cli: Callable[..., Outcome]) -> None:
    prompt = cli(*command, tiny.name)
    assert NOTE not in prompt.out + prompt.err
    tiny.write_text(tiny.read_text().replace("azimuth_sigma_deg: 0.5", "azimuth_sigma_deg: 0.5, latency_s: 0.25"))
    late = cli(*command, tiny.name)
    assert late.status == prompt.status == 0
    assert f"tiny.yaml:12: sensors.radar.latency_s: {NOTE}" in late.err
    assert NOTE not in late.out
