"""The committed comparison of tuned trackers: its page, the README's table and the shipped scenarios say the same."""

from __future__ import annotations

import json
from collections.abc import Iterable
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


def test_readme_has_the_table_of_the_page():
    heading = "## Which tracker is best where"
    tables = [
        table_after(heading, (folder / name).read_text(encoding="utf-8").splitlines())
        for folder, name in ((TUNED, "tuned.md"), (ROOT, "README.md"))
    ]
    assert len(tables[0]) == 2 + len(PROTOCOL.scenarios)
    assert tables[0] == tables[1]


def table_after(heading: str, lines: Iterable[str]) -> list[str]:
    lines = iter(lines)
    assert heading in lines
    table = []
    for line in lines:
        if line.startswith("|"):
            table.append(line)
        elif table:
            break
    return table
