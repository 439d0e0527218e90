"""The committed comparison of tuned trackers: its page and the shipped scenarios say the same."""

from __future__ import annotations

import json
from typing import Any

import pytest
import yaml
from benchmarks.tuned import page, shipped
from benchmarks.tuned.protocol import read
from tests.support.places import ROOT

TUNED = ROOT / "results" / "tuned"
PROTOCOL = read()


@pytest.fixture(scope="module")
def values() -> Any:
    return yaml.safe_load((TUNED / "values.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("scenario", PROTOCOL.scenarios)
def test_shipped_scenarios_have_the_values_of_their_family(scenario, values):
    text = (shipped.SCENARIOS / f"{scenario}.yaml").read_text(encoding="utf-8")
    assert text == shipped.tuned_text(PROTOCOL, values, scenario)


def test_page_is_that_of_its_numbers(values):
    scores = json.loads((TUNED / "tuned.json").read_text(encoding="utf-8"))
    assert (TUNED / "tuned.md").read_text(encoding="utf-8") == page.page(PROTOCOL, values, scores)
