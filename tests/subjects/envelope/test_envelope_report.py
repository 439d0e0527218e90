"""The page of an envelope, its figures and its text; a claim in one line, as a picture and as test cases."""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.patches import PathPatch
from rich.console import Console
from tests.subjects.envelope.conftest import Commanded
from tests.support.claims import claim_of, envelope_of

from trackbench.document.drawing import matplotlib_figure
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.document.palette import tracker_styles
from trackbench.document.terminal import print_document
from trackbench.subjects.envelope.api import FinishedEnvelope
from trackbench.subjects.envelope.claim import Envelope
from trackbench.subjects.envelope.files import save_envelope
from trackbench.subjects.envelope.map_figures import map_figure
from trackbench.subjects.envelope.report import (
    claim_sentence,
    envelope_document,
    envelope_summary,
    headlines,
)

AXES = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 3, "scale": "log"},
    "n": {"key": "sensors.radar.rate_hz", "values": [5, 10, 20]},
    "m": {"key": "sensors.radar.latency_ms", "from": 0, "to": 300, "levels": 4},
    "world": {"key": "truth.world", "choices": ["ideal", "human"]},
}
TRACKERS = {name: lambda *x, own=own: float(np.exp(sum(x) - own)) for own, name in [(0.4, "ekf"), (0.7, "imm")]}


def made(*axes, trackers=("ekf",), **more):
    ways = {name: AXES[name] for name in axes}
    return envelope_of(claim_of(ways, {name: TRACKERS[name] for name in trackers}, **more))


@pytest.mark.parametrize(
    ("axes", "trackers", "figures"),
    [
        ("q", ["ekf"], ["line-q-position-rmse"]),
        (["q", "world"], ["ekf", "imm"], ["line-q-position-rmse"]),
        (["world"], ["ekf"], []),
        ("qr", ["ekf"], ["map-ekf-q-r", "line-q-position-rmse", "line-r-position-rmse"]),
        (
            ["q", "r", "world"],
            ["ekf", "imm"],
            ["borders-q-r", "map-ekf-q-r", "map-imm-q-r", "line-q-position-rmse", "line-r-position-rmse"],
        ),
        (
            "qrn",
            ["ekf"],
            [*(f"map-ekf-{pair}" for pair in ("q-r", "q-n", "r-n")), *(f"line-{a}-position-rmse" for a in "qrn")],
        ),
    ],
)
def test_each_map_has_its_figures_and_can_be_read_in_every_format(axes, trackers, figures):
    envelope = made(*axes, trackers=trackers)
    document = envelope_document(envelope)
    assert [figure.name for figure in document.figures] == figures
    html, text = to_html(document), to_markdown(document)
    assert html.count('class="plot"') == len(figures)
    assert all(line in text.replace("**", "") for line in headlines(envelope.claim))
    console = Console(file=io.StringIO(), width=80)
    print_document(envelope_summary(envelope), console)
    assert max(map(len, console.file.getvalue().splitlines())) <= 80


def test_the_area_that_holds_is_that_of_the_triangles_between_cells_that_hold():
    """Cells that hold up to q = 2, and fail from 2.5: half of the map holds, a quarter is in the band."""
    claim = claim_of({"q": AXES["q"], "r": AXES["r"]}, {"ekf": lambda x, y: 0.5 + x})
    figure = map_figure(claim, (0, 1), *tracker_styles(["ekf"]).values())
    axes = matplotlib_figure(figure).axes[0]
    patches = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    spans = [(round(p.get_path().get_extents().x0, 6), round(p.get_path().get_extents().x1, 6)) for p in patches]
    assert spans == [(1.0, 1.5), (2.5, 3.0), (2.5, 3.0), (1.5, 2.5)]


def with_cells(claim, **changes):
    """The claim whose tracker has other entries in every cell."""
    cells = [
        cell.model_copy(
            update={"trackers": {name: own.model_copy(update=changes) for name, own in cell.trackers.items()}}
        )
        for cell in claim.cells
    ]
    return claim.model_copy(update={"cells": cells})


def test_the_claim_says_how_rare_a_kind_of_run_the_first_decided_cells_may_lack():
    claim = with_cells(made("q").claim, looks=1, runs=25)
    # One look of 25 runs of 400 spends a sixteenth: -log(1e-4 / 16) / 25.
    assert "the 25 runs that decided the first cells may lack one that makes up 48 % of all" in claim_sentence(claim)
    later = with_cells(claim, looks=2, runs=400)
    assert "the 400 runs that decided the first cells may lack one that makes up 2.3 % of all" in claim_sentence(later)
    assert "may lack" not in claim_sentence(with_cells(claim, state="undecided"))


def test_a_saved_envelope_is_written_again_by_report(cli, tmp_path: Path):
    folder = save_envelope(made("q", "r"), tmp_path)
    done = cli("report", folder, "--format", "html", "--out", "again.html")
    assert done.status == 0, done.err
    assert (tmp_path / "again.html").read_text() == (folder / "envelope.html").read_text()


def test_a_real_map_has_margins(small_envelope):
    finished = FinishedEnvelope(small_envelope)
    (margin,) = finished.margins
    (crossing,) = margin.crossings
    assert 0.1 <= crossing.low <= crossing.point <= crossing.high <= 1.0
    assert crossing.holds_below


def test_the_cells_as_test_cases(small_envelope: Envelope, commanded: Commanded) -> None:
    done, folder, _ = commanded

    (suite,) = ET.fromstring((folder / "cells.xml").read_text())
    counts = small_envelope.claim.counts("kf")
    assert done.exit_code == 0
    assert [int(suite.attrib[key]) for key in ("tests", "failures", "skipped")] == [
        len(small_envelope.claim.cells), counts["fails"], counts["undecided"]
    ]  # fmt: skip
    assert done.stdout.count("::error file=small.yaml,line=") == counts["fails"]
