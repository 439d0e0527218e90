"""The page of the comparison, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from .protocol import Protocol

Scores = dict[str, dict[str, dict[str, Any]]]
#: What a set of values for several scenarios may cost in error against values for the very scenario.
REGRET = 0.1


def page(protocol: Protocol, values: dict[str, dict[str, dict[str, Any]]], scores: Scores) -> str:
    """The whole page."""
    return "\n".join(
        [
            "# Trackers tuned alike",
            "",
            *_protocol(protocol),
            *_errors(protocol, scores),
            *_honesty(protocol, scores),
            *_regret(protocol, scores),
            *_values(protocol, values),
        ]
    )


def _protocol(protocol: Protocol) -> Iterator[str]:
    tuned, scored = protocol.tuned_on, protocol.scored_on
    yield "Made by `make tuned` from `benchmarks/tuned/protocol.yaml`."
    yield ""
    yield (
        f"Every tracker is tuned in the same way: {protocol.trials} trials of `trackbench tune --objective "
        f"{protocol.objective}` (the smallest position error of those whose mean NEES is consistent in every "
        f"condition, or nearest to it) on {tuned.scenes} scenes of {tuned.runs} runs, with other traffic and other "
        f"noise than the {scored.scenes} scenes of {scored.runs} runs that it is scored on here. It gets one set of "
        "values for a family of scenarios, and for comparison one for each scenario and one for all."
    )
    yield ""
    for family, names in protocol.families.items():
        yield f"- {family}: {', '.join(names)}"
    yield ""


def _errors(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Position error, values of the family"
    yield ""
    yield (
        "RMSE, m, with the 95 % interval over scenes; the smallest is bold. Smoothed: imm_cv_ca and a "
        "Rauch-Tung-Striebel smoother, what was to be had offline."
    )
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers, "smoothed"],
        [
            [name, *_bold([_error(of[f"{item}_family"]) for item in protocol.trackers]), _error(of["smoothed"])]
            for name, of in scores.items()
        ],
    )


def _honesty(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Whose covariance can be believed"
    yield ""
    yield (
        "Mean NEES, of which 4 is right, with the values of the family. Consistent: within 10 % over all estimates, and "
        "within -25 % and +50 % under every condition (each manoeuvre, each range, the first second, position and "
        "velocity alone); these are bold. Else the condition that is furthest off."
    )
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers],
        [[name, *(_nees(of[f"{item}_family"]) for item in protocol.trackers)] for name, of in scores.items()],
    )
    for which, words in (("family", "its family"), ("own", "the scenario itself"), ("all", "all scenarios")):
        honest = {
            name: [item for item in protocol.trackers if of[f"{item}_{which}"]["verdict"] == "consistent"]
            for name, of in scores.items()
        }
        some = [name for name, trackers in honest.items() if trackers]
        none = [name for name, trackers in honest.items() if not trackers]
        yield (
            f"With values of {words}, some tracker is consistent in every condition in {len(some)} of {len(honest)} "
            f"scenarios{', in none in ' + ', '.join(none) if none else ''}."
        )
        yield ""


def _regret(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## What one set of values costs"
    yield ""
    yield "Position error with the values of the family, and of all scenarios, over that with the scenario's own values."
    yield ""
    rows, worst = [], 0.0
    for name, of in scores.items():
        cells = [name]
        for item in protocol.trackers:
            own = of[f"{item}_own"]["position_rmse"]
            family, every = (of[f"{item}_{which}"]["position_rmse"] / own - 1.0 for which in ("family", "all"))
            worst = max(worst, family)
            cells.append(
                f"{'**' if family > REGRET else ''}{family:+.1%}{'**' if family > REGRET else ''}, {every:+.1%}"
            )
        rows.append(cells)
    yield from _table(["scenario", *protocol.trackers], rows)
    yield f"The largest cost of the values of a family is {worst:+.1%}; above {REGRET:.0%} they are bold."
    yield ""


def _values(protocol: Protocol, values: dict[str, dict[str, dict[str, Any]]]) -> Iterator[str]:
    yield "## The values"
    yield ""
    names = [*protocol.families, "all"]
    rows = [
        [f"{tracker}: `{key}`", *(f"{values[tracker][name][key]:.3g}" for name in names)]
        for tracker in protocol.trackers
        for key in values[tracker]["all"]
    ]
    yield from _table(["option", *names], rows)


def _error(scores: dict[str, Any]) -> str:
    low, high = scores["ci95"]
    return f"{scores['position_rmse']:.3f} (±{(high - low) / 2:.3f})"


def _nees(scores: dict[str, Any]) -> str:
    text = f"{scores['nees']:.1f}"
    if scores["verdict"] == "consistent":
        return f"**{text}**"
    if scores["off"]:
        name, mean = max(scores["off"].items(), key=lambda item: max(item[1] / 4, 4 / item[1]))
        return f"{text} ({name} {mean:.1f})"
    return f"{text} ({scores['verdict']})"


def _bold(cells: Sequence[str]) -> list[str]:
    least = min(cells)
    return [f"**{text}**" if text == least else text for text in cells]


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(headings)} |"
    yield f"| :-- |{' --: |' * (len(headings) - 1)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"
    yield ""
