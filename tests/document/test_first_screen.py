"""The elements of a first screen: bars on an axis, words of verdicts, folded sections, navigation, units."""

from __future__ import annotations

import re

import pytest

from trackbench.document import Cell, Column, Document, Section, Table, TrackerStyle, typeset
from trackbench.document.html import to_html

ERRORS = {"imm": (0.1, 0.08, 0.12), "ekf": (0.2, 0.18, 0.22), "raw": (1.0, 0.9, 1.1)}
TABLE = Table(
    "glance",
    (Column("tracker", left=True), Column("error, m"), Column("covariance", left=True)),
    tuple(
        (Cell(name, tracker=name), Cell(f"{bar[0]:.2f}", bar=bar), Cell("optimistic", tone="bad", chip=True))
        for name, bar in ERRORS.items()
    ),
)
DOCUMENT = Document(
    "report",
    "elements",
    (Section("Verdict", (TABLE,)), Section("In detail", (Section("More", (), folded=True),), folded=True)),
    trackers=(TrackerStyle("t0", "imm", "#112233"),),
)


def test_a_page_draws_bars_to_scale_and_says_which_goes_on() -> None:
    page = to_html(DOCUMENT)
    widths = [float(width) for width in re.findall(r'<rect x="0.00%" width="([\d.]+)%"', page)]
    assert widths == [pytest.approx(100 * value / 0.22, abs=0.01) for value in (0.1, 0.2)] + [100.0]
    assert page.count("beyond the axis") == page.count('class="bar cut-right"') == 1
    assert '<tr style="--mark: #112233">' in page
    assert page.count('<span class="chip bad">optimistic</span>') == 3


def test_bars_below_zero_begin_at_zero() -> None:
    changes = Table(
        "changes",
        (Column("change, %"),),
        ((Cell("-10", bar=(-10.0, -12.0, -8.0)),), (Cell("+30", bar=(30.0, 28.0, 32.0)),)),
    )
    assert changes.axis(0) == (-12.0, 32.0)
    page = to_html(Document("tuning", "changes", (changes,)))
    assert '<rect x="4.55%" width="22.73%"' in page
    assert '<rect x="27.27%" width="68.18%"' in page


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ("2.6 m/s^2 and 3 m/s3 for 5 s", "2.6~m/s² and 3~m/s³ for 5~s"),
        ("95 % of 3 scenes, 4 deg", "95~% of 3 scenes, 4~deg"),
        ("cost, m^2; m/s^2.5; 60 km/h", "cost, m²; m/s^2.5; 60~km/h"),
    ],
)
def test_units(plain: str, expected: str) -> None:
    assert typeset(plain).replace("\N{NO-BREAK SPACE}", "~") == expected
