"""The report of a run as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from trackbench.report import breakdown_tables
from trackbench.report.audit_words import audit_sentences
from trackbench.report.claims import QUANTITIES
from trackbench.report.tables import Cell, Table, expectations, innovations, key_differences, ranked, sensors
from trackbench.report.wording import expectations_met, facts, failure, headline, scored, unscored, verdict
from trackbench.results import Result

_SPACES = re.compile("[^\\S\N{NO-BREAK SPACE}]+")
#: What Markdown or HTML could take for its own; an underscore inside a word is safe.
_SPECIAL = re.compile(r"[\\`*\[\]<>|]|(?<!\w)_|_(?!\w)")


def render(result: Result) -> str:
    """The report of a run as Markdown: what :func:`trackbench.report.html.render` says, without its figures."""
    summary = result.json()
    order = scored(summary)
    lines = [f"# {escape(summary['scenario']['name'])}", ""]
    if summary["scenario"]["description"]:
        lines += [escape(summary["scenario"]["description"]), ""]
    lines += [escape(", ".join(facts(summary))), "", "## Verdict", "", f"**{escape(headline(summary))}**", ""]
    lines += [f"{expectations_met(summary['expectations'])}.", ""]
    lines += [f"{i}. **{escape(t['name'])}**: {escape(verdict(t, summary['runs']))}." for i, t in enumerate(order, 1)]
    lines += _section("Ranking", ranked(summary))
    missing = unscored(summary)
    if missing:
        lines += ["", "Without a score:", ""]
        lines += [f"- **{escape(tracker['name'])}**: {escape(failure(tracker))}" for tracker in missing]
    if len(order) > 1:
        lines += _section("Which differences are real", key_differences(summary), left=1)
    if order:
        for by in breakdown_tables.BY:
            lines += _section(f"By {by}", breakdown_tables.errors(summary, by), left=1)
            for quantity in QUANTITIES:
                title = f"Errors of the {quantity} over what each tracker claims"
                lines += _section(title, breakdown_tables.confidence(summary, by, quantity), left=1, level=3)
    found = innovations(summary)
    if found.rows:
        lines += _section("Innovations", found, left=1)
    if summary["expectations"]:
        lines += _section("Expectations", expectations(summary))
    lines += _section("Truth and sensors", sensors(summary))
    lines += ["", *(escape(sentence) for sentence in audit_sentences(summary["truth"].get("audit") or {}))]
    return "\n".join([*lines, *_reproduce(summary)]) + "\n"


def _section(title: str, found: Table, left: int = 2, level: int = 2) -> list[str]:
    lines = ["", f"{'#' * level} {title}", ""]
    lines += grid(
        [heading for heading, _ in found.headings], ([_cell(found, c) for c in row] for row in found.rows), left
    )
    if found.reasons:
        lines += ["", *(f"{i}. n/a: {escape(reason)}" for i, reason in enumerate(found.reasons, 1))]
    return lines


def _reproduce(summary: Mapping[str, Any]) -> list[str]:
    scenario = summary["scenario"]
    lines = ["", "## Reproduce", ""]
    if summary["command"]:
        lines += [*_fenced(summary["command"], "sh"), ""]
    lines += [f"{', '.join(f'{name} {number}' for name, number in summary['versions'].items())}.", ""]
    lines += [
        f"Fingerprint of all measurements: `{summary['fingerprint']}`",
        "",
        f"Scenario {escape(scenario['file'])}:",
        "",
    ]
    return lines + _fenced(scenario["text"], "yaml")


def _fenced(text: str, language: str) -> list[str]:
    """``text`` as it is, in a fence that is longer than any in it."""
    longest = max((len(found) for found in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return [f"{fence}{language}", text.rstrip("\n"), fence]


def grid(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int = 2) -> list[str]:
    """The lines of a table; the first ``left`` columns are flush left, the others right. Cells are Markdown."""
    rule = [":--" if i < left else "--:" for i in range(len(headings))]
    return [_row([escape(heading) for heading in headings]), _row(rule), *(_row(row) for row in rows)]


def escape(text: str) -> str:
    """``text`` as it is, in one line, whatever Markdown or HTML it looks like."""
    return _SPECIAL.sub(r"\\\g<0>", _SPACES.sub(" ", text).strip())


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(found: Table, cell: Cell) -> str:
    text = f"**{escape(cell.text)}**" if cell.tracker else escape(cell.text)
    mark = f"<sup>{found.mark(cell)}</sup>" if cell.reason else ""
    details = f" ({escape(', '.join(cell.details))})" if cell.details else ""
    return text + mark + details
