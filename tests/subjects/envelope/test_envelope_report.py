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


def test_a_terminal_shows_the_map_the_border_and_where_the_scenario_is() -> None:
    envelope = made(*"qr")
    console = Console(file=io.StringIO(), width=80)
    print_document(envelope_summary(envelope), console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "Near the scenario ekf holds along q in none of its 5 cells" in text
    rows = [line.split(None, 1)[1] for line in text.splitlines() if line.startswith((" 10 ", "  1 ", "0.1 "))]
    assert [row.strip() for row in rows[:3]] == ["x  x  x  x  x", "x  x [x] x  x", "#  #  x  x  x"]


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
            ["map-ekf-q-r", *(f"line-{axis}-position-rmse" for axis in "qrn"), "map-ekf-q-n", "map-ekf-r-n"],
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
    spans = [(p.get_path().get_extents().x0, p.get_path().get_extents().x1) for p in patches]
    # In shares of the axis: of the cells that hold, that fail, and of others.
    assert np.array(spans) == pytest.approx(np.array([(0.0, 0.25), (0.75, 1.0), (0.25, 0.75)]), abs=1e-9)


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
