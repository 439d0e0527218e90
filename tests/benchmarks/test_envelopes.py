"""The committed envelopes: pages without a row for each cell, and tables of cells that are those of the claims."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from benchmarks.envelopes import LONG, RESULTS, cells_csv

from trackbench.subjects.envelope.claim import Claim

CLAIMS = sorted(RESULTS.glob("*.json"))


@pytest.mark.parametrize("file", CLAIMS, ids=lambda file: file.stem)
def test_the_committed_cells_are_those_of_the_claim(file: Path) -> None:
    claim = Claim.model_validate(json.loads(file.read_text(encoding="utf-8")))
    committed = file.with_suffix(".csv").read_text(encoding="utf-8")
    assert committed == cells_csv(claim)
    rows = [*csv.DictReader(committed.splitlines())]
    for tracker in claim.trackers:
        own = [row for row in rows if row["tracker"] == tracker]
        states = [cell.trackers[tracker].state for cell in claim.cells]
        limits = max(1, len(claim.limits_of(tracker)))
        assert [row["state"] for row in own[::limits]] == states
    assert not [title for title in LONG if f"## {title}" in file.with_suffix(".md").read_text(encoding="utf-8")]
