"""A claim in one line a tracker, for a README, and as a picture."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from trackbench.subjects.envelope.claim import Claim, ClaimedLimit

_SIGNS = {"below": "<", "above": ">"}
#: Of the picture: height of a row, width of a letter, and margin, px.
_ROW, _LETTER, _MARGIN = 20, 6.6, 8
_GREEN, _GREY, _DARK = "#2e7d32", "#616161", "#333"


def badge_lines(claim: Claim) -> Iterator[str]:
    """As Markdown, such as "`ekf_cv`: position_rmse < 0.5 m in 142 of 200 cells (9 % undecided), 95 % confidence"."""
    made = f"{100 * claim.confidence:.4g} % confidence, {claim.claim}, trackbench {claim.versions['trackbench']}"
    for tracker in claim.trackers:
        limits = " and ".join(map(_limit, claim.limits_of(tracker)))
        yield f"`{tracker}`: {limits} {_share(claim, tracker)}, {made}"


def badge_svg(claim: Claim) -> str:
    """A row for each tracker: its name, and in how many cells it holds."""
    texts = [(tracker, _share(claim, tracker)) for tracker in claim.trackers]
    left, right = (max(len(pair[side]) for pair in texts) * _LETTER + 2 * _MARGIN for side in (0, 1))
    rows = []
    for number, (name, share) in enumerate(texts):
        holds = claim.counts(claim.trackers[number])["holds"]
        y, colour = number * _ROW, _GREEN if holds else _GREY
        rows += [
            f'<rect y="{y}" width="{left:.0f}" height="{_ROW}" fill="{_DARK}"/>',
            f'<rect x="{left:.0f}" y="{y}" width="{right:.0f}" height="{_ROW}" fill="{colour}"/>',
            f'<text x="{_MARGIN}" y="{y + 14}">{escape(name)}</text>',
            f'<text x="{left + _MARGIN:.0f}" y="{y + 14}">{escape(share)}</text>',
        ]
    size = f'width="{left + right:.0f}" height="{len(texts) * _ROW}"'
    style = 'font-family="DejaVu Sans Mono, monospace" font-size="11" fill="#fff"'
    title = f"<title>{escape('; '.join(badge_lines(claim)))}</title>"
    return "\n".join([f'<svg xmlns="http://www.w3.org/2000/svg" {size} {style}>', title, *rows, "</svg>", ""])


def _share(claim: Claim, tracker: str) -> str:
    counts, cells = claim.counts(tracker), len(claim.cells)
    return f"in {counts['holds']} of {cells} cells ({100 * counts['undecided'] / cells:.0f} % undecided)"


def _limit(limit: ClaimedLimit) -> str:
    if limit.other is not None:
        return f"{limit.metric} better than `{limit.other}`"
    unit = "" if limit.unit == "1" else f" {limit.unit}"
    return f"{limit.metric} {_SIGNS[limit.direction]} {limit.limit:g}{unit}"
