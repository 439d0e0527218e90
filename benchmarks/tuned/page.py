"""The page of the comparison, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from trackbench.metrics.verdicts import ABOVE, BELOW, SMALLEST_SHARE, TOLERANCE
from trackbench.subjects.tuning.objectives import PRICE
from trackbench.subjects.tuning.parameters import Parameter

from .protocol import Protocol
from .trust import DOF, Scores, believable, by_distance, described, furthest, reasons, undecided

#: What a set of values for several scenarios may cost in error against values for the very scenario.
REGRET = 0.1
#: The condition of which an own table is made.
TURNING = "turning"
WITHIN = DOF * (1 - TOLERANCE), DOF * (1 + TOLERANCE)
UNDER = DOF * (1 - BELOW), DOF * (1 + ABOVE)
TRUSTED = (
    f"shown to be within {WITHIN[0]:.1f} and {WITHIN[1]:.1f}, where {DOF} is right, over all estimates, and within "
    f"{UNDER[0]:g} and {UNDER[1]:g} under every condition that has {100 * SMALLEST_SHARE:.0f} % of the estimates: each "
    "manoeuvre, each range, position and velocity alone"
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
        f"its ranges, for the objective `{protocol.objective}` of `trackbench tune` (the position error, and a price "
        "on the mean NEES that is furthest off in any condition: each per cent beyond counts as much as "
        f"{PRICE:g} % of error), on {protocol.tuned_on}. It is scored on {protocol.scored_on} with other traffic and "
        "other noise. It has one set of values for a family of scenarios; beside them stand one for the scenario alone "
        "and one for all."
    )
    yield ""
    for family, names in protocol.families.items():
        yield f"- {family}: {', '.join(names)}"
    yield ""
    yield protocol.remarks
    yield ""


def _summary(protocol: Protocol, scores: Scores) -> Iterator[str]:
    trackers = list(protocol.trackers)
    yield "## Which tracker is best where"
    yield ""
    yield (
        "Position RMSE with the values of the family, m, with the 95 % interval over scenes. Not shown worse: by more "
        "than 1 % or 5 mm, paired over scenes, which is no proof of equality. Believable: trackers whose mean NEES is "
        f"{TRUSTED}; else those of which these scenes do not decide; else the nearest, with its mean NEES that is "
        "furthest off. Smoothed: `imm_cv_ca` with a Rauch-Tung-Striebel smoother, which uses later measurements too."
    )
    yield ""
    yield from _table(
        ["scenario", "best", "RMSE", "not shown worse", "believable", "smoothed"],
        [
            [
                name,
                of["best"],
                _error(of["scores"][of["best"]]),
                ", ".join(of["not shown to be worse"]) or "none",
                _believable(trackers, of["scores"]),
                _error(of["scores"]["smoothed"]),
            ]
            for name, of in scores.items()
        ],
    )
    none = [of for of in scores.values() if not believable(trackers, of["scores"])]
    is_open = [of for of in none if undecided(trackers, of["scores"])]
    with_own = [of for of in none if believable(list(of["own"]), of["own"])]
    unturned = [name for name, of in scores.items() if TURNING not in of["scores"][of["best"]]["conditions"]]
    yield (
        f"Some tracker is shown to be believable with the values of the family in {len(scores) - len(none)} of "
        f"{len(scores)} scenarios, and with the scenario's own, of the nearest, in {len(with_own)} more; in "
        f"{len(is_open)} these scenes do not decide, and in {len(none) - len(is_open)} each is shown to be off "
        f"somewhere. Too few estimates are in turns to be judged in: {', '.join(unturned)}."
    )
    yield ""


def _believable(trackers: Sequence[str], scores: Scores) -> str:
    if right := believable(trackers, scores):
        return ", ".join(right)
    if open_of := undecided(trackers, scores):
        return f"not decided of {', '.join(open_of)}"
    best = by_distance(trackers, scores)[0]
    return f"none; {best}: {described(furthest(scores[best]))}"


def _reasons(protocol: Protocol, scores: Scores) -> Iterator[str]:
    trackers = list(protocol.trackers)
    none = {name: of for name, of in scores.items() if not believable(trackers, of["scores"])}
    if none:
        yield "## Where none is shown to be believable"
        yield ""
        yield "Mean NEES, of which 4 is right, with the values of the family; of the others in brackets what they miss."
        yield ""
        for name, of in none.items():
            yield f"- {name}: {'; '.join(reasons(trackers, of['scores'], of['own']))}."
        yield ""


def _errors(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Position error"
    yield ""
    yield (
        "RMSE with the values of the family, m; bold: the best and those not shown worse. In brackets: runs that "
        "diverged."
    )
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
        f"Mean NEES with the values of the family, of which 4 is right. Bold: {TRUSTED}. Otherwise the condition that "
        "is furthest off, or that these scenes do not decide; position and velocity alone are doubled, so that 4 is "
        "right of them too."
    )
    yield ""
    yield from _table(
        ["scenario", *protocol.trackers],
        [[name, *(_nees(of["scores"][item]) for item in protocol.trackers)] for name, of in scores.items()],
    )


def _turning(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## In turns"
    yield ""
    yield (
        "Mean NEES while a vehicle turns, with the values of the family; bold: shown to be within "
        f"{UNDER[0]:g} and {UNDER[1]:g}."
    )
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
    yield "## Error with one set of values"
    yield ""
    yield (
        "Position error with the values of the family, and with those of all scenarios, over that with the scenario's "
        f"own values, on {protocol.compared_on}; above {100 * REGRET:.0f} % bold. It is no full cost: all values are "
        "chosen for error and consistency together, so that it may be below zero. Left out: a scenario that is a "
        "family by itself."
    )
    yield ""
    rows, worst = [], []
    for name, of in scores.items():
        if len(protocol.families[protocol.family_of(name)]) == 1:
            continue
        cells = [name]
        for item in protocol.trackers:
            error = {which: of["position_rmse"][which][item] for which in ("own", "family", "all")}
            ratios = [error[which] / error["own"] - 1.0 for which in ("family", "all")]
            worst.append((ratios[0], name, item))
            cells.append(", ".join(_bold(f"{ratio:+.1%}", ratio > REGRET) for ratio in ratios))
        rows.append(cells)
    yield from _table(["scenario", *protocol.trackers], rows)
    value, name, item = max(worst)
    yield (
        f"With the values of the family it is at most {100 * REGRET:.0f} % larger in "
        f"{sum(ratio <= REGRET for ratio, _, _ in worst)} of {len(worst)} cases, and {value:.1%} at most, of {item} in "
        f"{name}."
    )
    yield ""


def _values(protocol: Protocol, values: Mapping[str, Any]) -> Iterator[str]:
    yield "## The values"
    yield ""
    yield "In brackets: at an end of the range that was searched, so that a better one may lie beyond."
    yield ""
    names = [*protocol.families, "all"]
    loaded = protocol.loaded(protocol.scenarios[0], protocol.entries)
    rows = [
        [f"{tracker}: `{option.key}`", *(_value(option, values[tracker][name][option.key]) for name in names)]
        for tracker in protocol.trackers
        for option in protocol.parameters(tracker, loaded)
    ]
    yield from _table(["option", *names], rows)


def _value(option: Parameter, value: float) -> str:
    return f"{value:.3g}" if option.edge(value) is None else f"({value:.3g})"


def _error(scores: Scores) -> str:
    low, high = scores["ci95"]
    diverged = f" [{scores['diverged']}]" if scores["diverged"] else ""
    return f"{scores['position_rmse']:.3f} (±{(high - low) / 2:.3f}){diverged}"


def _nees(scores: Scores) -> str:
    text = f"{scores['nees']:.1f}"
    if scores["verdict"] == "consistent":
        return f"**{text}**"
    if scores["verdict"] == "undecided":
        return f"{text} (not decided)"
    off = furthest(scores)
    return f"{text} ({off.condition} {off.value:.1f})" if off.condition else text


def _bold(text: str, where: bool) -> str:
    return f"**{text}**" if where else text


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(headings)} |"
    yield f"| :-- |{' --: |' * (len(headings) - 1)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"
    yield ""
