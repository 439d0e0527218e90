"""A claim in one line, and as a picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from tests.subjects.envelope.conftest import Commanded

from trackbench.subjects.envelope.claim import Envelope
from trackbench.subjects.envelope.files import save_envelope

SVG = "{http://www.w3.org/2000/svg}"


def test_badge(small_envelope: Envelope, tmp_path: Path, cli: Callable[..., Any]) -> None:
    claim = small_envelope.claim
    save_envelope(small_envelope, tmp_path)
    counts, version, total = claim.counts("kf"), claim.versions["trackbench"], len(claim.cells)
    share = f"in {counts['holds']} of {total} cells ({100 * counts['undecided'] / total:.0f} % undecided)"

    done = cli("envelope", "badge", "small-envelope", "--svg", "badge.svg")

    assert done.status == 0
    assert done.out == f"`kf`: position_rmse < 0.25 m {share}, 95 % confidence, these scenes, trackbench {version}\n"
    picture = ET.fromstring((tmp_path / "badge.svg").read_text())
    assert [text.text for text in picture.iter(f"{SVG}text")] == ["kf", share]


def test_the_cells_as_test_cases(small_envelope: Envelope, commanded: Commanded) -> None:
    done, folder, _ = commanded

    (suite,) = ET.fromstring((folder / "cells.xml").read_text())
    counts = small_envelope.claim.counts("kf")
    assert done.exit_code == 0
    assert [int(suite.attrib[key]) for key in ("tests", "failures", "skipped")] == [
        len(small_envelope.claim.cells), counts["fails"], counts["undecided"]
    ]  # fmt: skip
    assert done.stdout.count("::error file=small.yaml,line=") == counts["fails"]
