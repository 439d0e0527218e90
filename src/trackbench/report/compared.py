"""A comparison of runs for a terminal of 80 columns, as Markdown and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from trackbench.compare.differences import BETTER, WORSE, Difference, Entrant, Outcome
from trackbench.compare.regression import ERROR, FAILED, PASSED, UNDECIDED, Judgement
from trackbench.report.markdown import escape, grid
from trackbench.report.numbers import decimals, fixed, interval
from trackbench.words import counted

SCHEMA_VERSION = 1
_VERDICT_STYLE = {BETTER: "green", WORSE: "bold red"}
_OUTCOME_STYLE = {FAILED: "bold red", ERROR: "bold red", UNDECIDED: "yellow"}


def print_comparison(outcome: Outcome, judgements: Sequence[Judgement], console: Console) -> None:
    """The runs, a table of differences for each metric, and what became of the limits."""
    for line in _headings(outcome):
        console.print(Text(line), highlight=False, soft_wrap=True)
    for metric, items in _by_metric(outcome):
        console.print()
        console.print(Text(f"{metric}, {items[0].unit}"), style="bold", highlight=False)
        console.print(_table(outcome, items))
    for note in (*_explanations(outcome), *outcome.notes):
        console.print(Text(note, style="dim"), highlight=False)
    for missing in outcome.missing:
        why = f"{missing.metric}: {missing.reason}"
        console.print(Text.assemble(("NOT COMPARED ", "yellow"), why), highlight=False, soft_wrap=True)
    for item in judgements:
        if item.outcome != PASSED:
            label = (f"{item.outcome.upper()} ", _OUTCOME_STYLE[item.outcome])
            console.print(Text.assemble(label, _judged(item)), highlight=False, soft_wrap=True)
    if judgements:
        kept = sum(item.outcome == PASSED for item in judgements)
        text = f"{kept} of {counted(len(judgements), 'limit')} kept"
        console.print(Text(text), style="bold", highlight=False)


def to_markdown(outcome: Outcome, judgements: Sequence[Judgement]) -> str:
    """The whole comparison, to be read or kept."""
    lines = ["# Comparison", "", *(f"- {escape(line)}" for line in _headings(outcome)), ""]
    for metric, items in _by_metric(outcome):
        places = _places(items)
        rows = [
            [
                escape(_name(outcome, item.entrant, item.against)),
                escape(_name(outcome, item.against, item.entrant)),
                fixed(item.value, places),
                fixed(item.reference, places),
                fixed(item.difference, places),
                interval(item.ci95, places) or "n/a",
                _percent(item),
                _p_value(item.p_value),
                f"**{item.verdict}**" if item.verdict in _VERDICT_STYLE else item.verdict,
            ]
            for item in items
        ]
        headings = ["", "against", "value", "its value", "difference", "95 % interval", "%", "p", "verdict"]
        lines += [f"## {metric}, {items[0].unit}", "", *grid(headings, rows, left=2), ""]
    notes = (
        *_explanations(outcome),
        *outcome.notes,
        *(f"{m.metric} not compared: {m.reason}" for m in outcome.missing),
    )
    lines += [f"- {escape(note)}" for note in notes]
    if judgements:
        lines += ["", "## Regressions", ""]
        lines += [f"- **{item.outcome}**: {escape(_judged(item))}" for item in judgements]
    return "\n".join(lines) + "\n"


def to_json(outcome: Outcome, judgements: Sequence[Judgement]) -> dict[str, Any]:
    """The whole comparison as JSON values."""
    grounds = [None, *outcome.grounds]
    return {
        "schema_version": SCHEMA_VERSION,
        "runs": [
            {
                "label": run.label,
                "scenario": run.summary.scenario.name,
                "seed": run.summary.seed,
                "runs": run.summary.runs,
                "fingerprint": run.summary.fingerprint,
                "paired": None if ground is None else ground.paired,
                "reason": None if ground is None else ground.reason,
            }
            for run, ground in zip(outcome.runs, grounds, strict=True)
        ],
        "differences": [
            {
                "metric": item.metric,
                "unit": item.unit,
                "entrant": item.entrant._asdict(),
                "against": item.against._asdict(),
                "value": item.value,
                "against_value": item.reference,
                "difference": item.difference,
                "ci95": None if item.ci95 is None else list(item.ci95),
                "percent": item.percent,
                "p_value": item.p_value,
                "paired": item.paired,
                "verdict": item.verdict,
            }
            for item in outcome.differences
        ],
        "missing": [
            {
                "metric": item.metric,
                "entrant": item.entrant._asdict(),
                "against": item.against._asdict(),
                "reason": item.reason,
            }
            for item in outcome.missing
        ],
        "regressions": [
            {
                "metric": item.limit.metric,
                "percent": item.limit.percent,
                "entrant": item.entrant._asdict(),
                "outcome": item.outcome,
                "text": item.text,
            }
            for item in judgements
        ],
        "notes": list(outcome.notes),
        "passed": all(item.outcome not in (FAILED, ERROR) for item in judgements),
    }


def _headings(outcome: Outcome) -> list[str]:
    """What is compared, and on what grounds."""
    found = []
    for number, run in enumerate(outcome.runs):
        name = f"{_letter(number)}: " if len(outcome.runs) > 1 else ""
        what = f"{run.summary.scenario.name}, {counted(run.summary.runs, 'run')}, seed {run.summary.seed}"
        found.append(f"{name}{run.label}: {what}")
        if number > 0:
            ground = outcome.grounds[number - 1]
            found.append(f"   {'paired' if ground.paired else 'unpaired'}: {ground.reason}")
    return found


def _explanations(outcome: Outcome) -> list[str]:
    counts = [len(items) for _, items in _by_metric(outcome)]
    found = []
    if outcome.differences:
        found.append("±: 95 %, of the difference; %: of the value that it is held against")
        tests = {True: "paired over the runs", False: "unpaired (Welch's test)"}
        found.append(
            "differences are " + " or ".join(tests[way] for way in sorted({d.paired for d in outcome.differences}))
        )
    if max(counts, default=0) > 1:
        found.append(f"verdicts at a level of 5 %, corrected for {max(counts)} differences (Holm)")
    return found


def _by_metric(outcome: Outcome) -> list[tuple[str, list[Difference]]]:
    metrics = dict.fromkeys(item.metric for item in outcome.differences)
    return [(metric, [item for item in outcome.differences if item.metric == metric]) for metric in metrics]


def _table(outcome: Outcome, items: Sequence[Difference]) -> Table:
    places = _places(items)
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("tracker", overflow="fold")
    table.add_column("against", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("difference", justify="right", no_wrap=True)
    table.add_column("%", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for item in items:
        table.add_row(
            Text(_name(outcome, item.entrant, item.against), style="bold"),
            Text(_name(outcome, item.against, item.entrant)),
            fixed(item.value, places),
            "0 in every run" if item.identical else fixed(item.difference, places) + _half_width(item, places),
            _percent(item),
            Text(item.verdict, style=_VERDICT_STYLE.get(item.verdict, "")),
        )
    return table


def _places(items: Sequence[Difference]) -> int:
    """Decimals that show the values to three digits and the smallest uncertainty to one."""
    widths = [(d.ci95[1] - d.ci95[0]) / 2 for d in items if d.ci95 is not None and not d.identical]
    return max(decimals([item.value for item in items]), decimals(widths, 1) if widths else 0)


def _half_width(item: Difference, places: int) -> str:
    return "" if item.ci95 is None else f" ±{fixed((item.ci95[1] - item.ci95[0]) / 2, places)}"


def _percent(item: Difference) -> str:
    if item.percent is None:
        return "n/a"
    return ("+" if item.percent > 0 else "") + fixed(item.percent, 1 if abs(item.percent) < 10 else 0)


def _p_value(value: float) -> str:
    return "<0.001" if value < 0.001 else fixed(value, 3)


def _name(outcome: Outcome, entrant: Entrant, other: Entrant) -> str:
    """As short as tells the two apart."""
    if len(outcome.runs) == 1:
        return entrant.tracker
    if entrant.run == 0 and entrant.tracker == other.tracker:
        return _letter(0)
    return f"{entrant.tracker} {_letter(entrant.run)}"


def _judged(item: Judgement) -> str:
    return f"{item.entrant.tracker} {_letter(item.entrant.run)}, {item.limit.metric}: {item.text}"


def _letter(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else str(number + 1)
