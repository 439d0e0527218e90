"""A cell that does not hold any more is found; the same map with other noise is not taken for a worse one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from tests.support.claims import claim_of
from tests.support.claims import envelope_of as made_of

from trackbench.base.errors import InputError
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.claim import CellValue, Envelope
from trackbench.subjects.envelope.diff import EnvelopeDiff, diff
from trackbench.subjects.envelope.files import save_envelope
from trackbench.subjects.envelope.mapping import EnvelopeMap

Cli = Callable[..., Any]
Made = Callable[..., EnvelopeMap]

RUNS = {"first": 25, "most": 100}
#: A filter that trusts its measurements more.
WORSE = {
    "kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 6},
    "loose": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 10},
}


@pytest.fixture(scope="module")
def envelope(made_map: Made) -> Callable[..., Envelope]:
    """Of the small scenario with other values."""
    return lambda **changes: envelope_of(made_map(runs=RUNS, **changes), "trackbench envelope small.yaml")


@pytest.fixture(scope="module")
def before(envelope: Callable[..., Envelope]) -> Envelope:
    return envelope()


@pytest.fixture(scope="module")
def after(envelope: Callable[..., Envelope]) -> Envelope:
    return envelope(trackers=WORSE)


@pytest.fixture(scope="module")
def worse(before: Envelope, after: Envelope) -> EnvelopeDiff:
    return diff(before, after)


def test_a_map_does_not_differ_from_itself(before: Envelope) -> None:
    found = diff(before, before)

    assert found.passed
    assert {item.outcome for item in found.changes} == {"same"}
    assert all(item.paired for item in found.changes)
    assert not found.margins
    assert not found.left_out


def test_other_noise_is_no_regression(before: Envelope, envelope: Callable[..., Envelope]) -> None:
    found = diff(before, envelope(monte_carlo={"runs": 20, "seed": 2}))

    assert found.passed
    assert not any(item.paired for item in found.changes)


def test_a_regression_is_found_and_located_on_its_axis(worse: EnvelopeDiff) -> None:
    lost = worse.of("lost")

    assert not worse.passed
    # The border goes from .39 to .29 m.
    assert lost
    assert all(0.25 < float(item.point[0]) < 0.45 for item in lost)
    (margin,) = worse.margins
    assert margin.startswith("kf along sigma: up to 0.3")


def test_an_improvement_loses_nothing(before: Envelope, after: Envelope) -> None:
    found = diff(after, before)

    assert found.passed
    assert found.of("gained")


@pytest.mark.parametrize(("low", "high", "outcome"), [(0.9, 0.945, "not shown"), (0.7, 0.85, "lost")])
def test_a_smaller_coverage_is_lost_where_it_is_shown_to_be_smaller(low: float, high: float, outcome: str) -> None:
    axes = {"q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 2}}
    claim = claim_of(axes, {"ekf": lambda _: 0.5})
    maps = []
    for state, bounds in (("holds", (0.93, 0.98)), ("fails", (low, high))):
        coverage = CellValue(state=state, value=sum(bounds) / 2, low=bounds[0], high=bounds[1])
        cells = [
            cell.model_copy(
                update={
                    "trackers": {"ekf": cell.trackers["ekf"].model_copy(update={"state": state, "coverage": coverage})}
                }
            )
            for cell in claim.cells
        ]
        maps.append(made_of(claim.model_copy(update={"cells": cells})))

    assert {item.outcome for item in diff(*maps).changes} == {outcome}


def test_what_cannot_be_compared_is_refused(before: Envelope, envelope: Callable[..., Envelope]) -> None:
    two = {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 0.9]}
    small = {"cells": 4}
    others = {
        "different axes": envelope(axes={"noise": two}),
        "requirement": envelope(**small, expect=[{"tracker": "kf", "metric": "position_rmse", "below": 0.3}]),
        "no tracker": envelope(**small, expect=[{"tracker": "loose", "metric": "position_rmse", "below": 0.25}]),
    }
    for words, other in others.items():
        with pytest.raises(InputError, match=words):
            diff(before, other)


def test_the_command(worse: EnvelopeDiff, before: Envelope, after: Envelope, tmp_path: Path, cli: Cli) -> None:
    for name, made in (("a", before), ("b", after)):
        save_envelope(made, tmp_path / name)
    places = ("a/small-envelope", "b/small-envelope")

    same, lost = cli("envelope", "diff", places[0], places[0]), cli("envelope", "diff", *places, "--junit", "j.xml")
    printed = json.loads(cli("envelope", "diff", *places, "--json").out)

    assert (same.status, lost.status) == (0, 1)
    assert lost.out.splitlines() == [*worse.lines()]
    assert printed["passed"] is False
    assert len(printed["changes"]) == len(worse.changes) - len(worse.of("same"))
    (suite,) = ET.fromstring((tmp_path / "j.xml").read_text())
    assert int(suite.attrib["tests"]) == len(worse.changes)
    assert int(suite.attrib["failures"]) == len(worse.of("lost"))
