"""The page of the comparison, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from trackbench.metrics.verdicts import ABOVE, BELOW, TOLERANCE
from trackbench.tuning.objectives import PRICE

from .protocol import Protocol
from .trust import Scores, believable, described, means, nearest, reasons

#: What a set of values for several scenarios may cost in error against values for the very scenario.
REGRET = 0.1
#: The condition of which an own table is made.
TURNING = "turning"
BAND = f"-{100 * BELOW:.0f} and +{100 * ABOVE:.0f} %"
TRUSTED = (
    f"within {100 * TOLERANCE:.0f} % of 4 over all estimates, and within {BAND} under every condition: each manoeuvre, "
    "each range, the first second, position and velocity alone"
)


def page(protocol: Protocol, values: Mapping[str, Any], scores: Scores) -> str:
    """The whole page."""
    parts = (
        ["# Trackers tuned alike", ""],
        _protocol(protocol),
        _summary(protocol, scores),
        _reasons(protocol, scores),
        _errors(protocol, scores),
        _trust(protocol, scores),
        _turning(protocol, scores),
        _regret(protocol, scores),
        _values(protocol, values),
    )
    return "\n".join(line for part in parts for line in part)


def _protocol(protocol: Protocol) -> Iterator[str]:
    yield "Made by `make tuned` from `benchmarks/tuned/protocol.yaml`."
    yield ""
    yield (
        f"Every tracker is tuned in the same way: {protocol.trials} trials, of which {protocol.spread} are spread over "
        f"its ranges, for the objective `{protocol.objective}` of `trackbench tune` (the smallest position error with "
        "a mean NEES that is consistent in every condition; each per cent beyond counts as much as "
        f"{PRICE:g} % of error), on {protocol.tuned_on}. It is scored on {protocol.scored_on} with other traffic and "
        "other noise. It has one set of values for a family of scenarios; beside them stand one for the very scenario "
        "and one for all."
    )
    yield ""
    for family, names in protocol.families.items():
        yield f"- {family}: {', '.join(names)}"
    yield ""


def _summary(protocol: Protocol, scores: Scores) -> Iterator[str]:
    trackers = list(protocol.trackers)
    yield "## Which tracker is best where"
    yield ""
    yield (
        "Position RMSE with the values of the family, m, with the 95 % interval over scenes. As good: not shown to be "
        "worse by more than 1 % or 5 mm. Believable: trackers whose mean NEES is "
        f"{TRUSTED}; where none is shown to be, the nearest, with its mean NEES that is furthest off, or not decided "
        "where all are within these bounds but their intervals are not. Smoothed: the errors of "
        "`imm_cv_ca` after a Rauch-Tung-Striebel smoother, what was to be had offline."
    )
    yield ""
    yield from _table(
        ["scenario", "best", "RMSE", "as good", "believable", "smoothed"],
        [
            [
                name,
                of["best"],
                _error(of["scores"][of["best"]]),
                ", ".join(of["not shown to be worse"]) or "none",
                ", ".join(believable(trackers, of["scores"])) or _nearest(trackers, of["scores"]),
                _error(of["scores"]["smoothed"]),
            ]
            for name, of in scores.items()
        ],
    )
    none = [of for of in scores.values() if not believable(trackers, of["scores"])]
    with_own = [of for of in none if believable(list(of["own"]), of["own"])]
    undecided = [of for of in none if of not in with_own and nearest(trackers, of["scores"])[1].beyond <= 0.0]
    yield (
        f"Some tracker is believable with the values of the family in {len(scores) - len(none)} of {len(scores)} "
        f"scenarios, in {len(with_own)} more with the scenario's own; in {len(undecided)} more these scenes do not "
        "decide."
    )
    yield ""


def _reasons(protocol: Protocol, scores: Scores) -> Iterator[str]:
    trackers = list(protocol.trackers)
    none = {name: of for name, of in scores.items() if not believable(trackers, of["scores"])}
    if none:
        yield "## Why none is believable"
        yield ""
        yield "Mean NEES, of which 4 is right, with the values of the family; of the others in brackets what they miss."
        yield ""
        for name, of in none.items():
            yield f"- {name}: {'; '.join(reasons(trackers, of['scores'], of['own']))}."
        yield ""


def _nearest(trackers: Sequence[str], scores: Scores) -> str:
    best, off = nearest(trackers, scores)
    return f"not decided of {best}" if off.beyond <= 0.0 else f"none; {best}: {described(off)}"


def _errors(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Position error"
    yield ""
    yield "RMSE with the values of the family, m; bold: the best and those as good. In brackets: runs that diverged."
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers, "smoothed"],
        [
            [
                name,
                *(
                    _bold(_error(of["scores"][item]), item == of["best"] or item in of["not shown to be worse"])
                    for item in (*protocol.trackers, "smoothed")
                ),
            ]
            for name, of in scores.items()
        ],
    )


def _trust(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Whose covariance can be believed"
    yield ""
    yield (
        f"Mean NEES with the values of the family, of which 4 is right. Bold: {TRUSTED}. Else the condition that is "
        "furthest off, or what is not decided; position and velocity alone are doubled, so that 4 is right of them too."
    )
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers],
        [[name, *(_nees(of["scores"][item]) for item in protocol.trackers)] for name, of in scores.items()],
    )


def _turning(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## In turns"
    yield ""
    yield f"Mean NEES while a vehicle turns, with the values of the family; bold: shown to be within {BAND} of it."
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers],
        [
            [
                name,
                *(
                    _bold(f"{turning['mean']:.1f}", turning["verdict"] == "consistent")
                    for turning in (of["scores"][item]["conditions"][TURNING] for item in protocol.trackers)
                ),
            ]
            for name, of in scores.items()
            if TURNING in of["scores"][of["best"]]["conditions"]
        ],
    )


def _regret(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## What one set of values costs"
    yield ""
    yield (
        "Position error with the values of the family, and of all scenarios, over that with the scenario's own values, "
        f"on {protocol.compared_on}; above {100 * REGRET:.0f} % bold. Less than nothing is "
        "possible: the values are chosen for consistency first."
    )
    yield ""
    rows, worst = [], []
    for name, of in scores.items():
        cells = [name]
        for item in protocol.trackers:
            error = {which: of["position_rmse"][which][item] for which in ("own", "family", "all")}
            ratios = [error[which] / error["own"] - 1.0 for which in ("family", "all")]
            worst.append((ratios[0], name, item))
            cells.append(", ".join(_bold(f"{ratio:+.1%}", ratio > REGRET) for ratio in ratios))
        rows.append(cells)
    yield from _table(["scenario", *protocol.trackers], rows)
    value, name, item = max(worst)
    yield f"The largest cost of the values of a family is {value:+.1%}, of {item} in {name}."
    yield ""


def _values(protocol: Protocol, values: Mapping[str, Any]) -> Iterator[str]:
    yield "## The values"
    yield ""
    names = [*protocol.families, "all"]
    rows = [
        [f"{tracker}: `{key}`", *(f"{values[tracker][name][key]:.3g}" for name in names)]
        for tracker in protocol.trackers
        for key in values[tracker]["all"]
    ]
    yield from _table(["option", *names], rows)


def _error(scores: Scores) -> str:
    low, high = scores["ci95"]
    diverged = f" [{scores['diverged']}]" if scores["diverged"] else ""
    return f"{scores['position_rmse']:.3f} (±{(high - low) / 2:.3f}){diverged}"


def _nees(scores: Scores) -> str:
    text = f"{scores['nees']:.1f}"
    if scores["verdict"] == "consistent":
        return f"**{text}**"
    off = max(means(scores))
    if off.beyond > 0.0:
        return f"{text} ({off.condition} {off.mean:.1f})" if off.condition else text
    return f"{text} (not decided)"


def _bold(text: str, where: bool) -> str:
    return f"**{text}**" if where else text


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(headings)} |"
    yield f"| :-- |{' --: |' * (len(headings) - 1)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"
    yield ""
