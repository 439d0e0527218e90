"""The page of the comparison, in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..markdown import table
from .protocol import Protocol

METRICS = ("position_rmse", "velocity_rmse")
#: What a set of values for several scenarios may cost in error against values for the very scenario.
REGRET = 0.1

Scores = Mapping[str, Any]


def page(protocol: Protocol, values: Mapping[str, Any], scores: Scores) -> str:
    """The whole page."""
    parts = (
        ["# Trackers tuned alike", ""],
        _protocol(protocol),
        _best(protocol, scores),
        _errors(protocol, scores),
        _covariance(protocol, scores),
        _regret(protocol, scores),
        _values(protocol, values),
    )
    return "\n".join(line for part in parts for line in part)


def _protocol(protocol: Protocol) -> Iterator[str]:
    yield "Made by `make tuned` from `benchmarks/tuned/protocol.yaml`."
    yield ""
    yield (
        f"Every tracker is tuned in the same way: {protocol.trials} trials "
        f"for the objective `{protocol.objective}` of `trackbench tune`, on {protocol.tuned_on}. It is "
        f"scored on {protocol.scored_on} with other traffic and other noise. It has one set of values for a family of "
        "scenarios, and beside it one for the scenario alone:"
    )
    yield ""
    for family, names in protocol.families.items():
        yield f"- {family}: {', '.join(names)}"
    yield ""
    yield protocol.remarks
    yield ""


def _best(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Which tracker is best where"
    yield ""
    yield (
        "Smallest RMSE with its 95 % interval over scenes; in brackets how many others are not shown to be worse by "
        "more than 1 % and 5 mm, paired over scenes, which is no proof of equality. All are tuned for the position; "
        "the velocity is that of the same values, and is not tested."
    )
    yield ""
    yield from table(
        ["scenario", "position, m", "velocity, m/s", "position with the scenario's own values"],
        [
            [
                name,
                *(_winner(of["family"], metric) for metric in METRICS),
                _winner(of["own"], "position_rmse"),
            ]
            for name, of in scores.items()
        ],
    )
    changed = [name for name, of in scores.items() if _leader(of["own"]) != _leader(of["family"])]
    wins = [_leader(of["own"]) for of in scores.values()]
    most = max(protocol.trackers, key=wins.count)
    yield (
        f"With the scenario's own values {most} has the smallest position error in {wins.count(most)} of {len(scores)} "
        f"scenarios, and the tracker that has it changes in {len(changed)}."
    )
    yield ""


def _leader(scores: Scores) -> str:
    return str(scores["position_rmse"]["best"])


def _winner(scores: Scores, metric: str) -> str:
    """ "imm_three 0.106 ±0.005 (2)"."""
    best, others = scores[metric]["best"], scores[metric]["not worse"]
    return f"{best} {_error(scores['trackers'][best][metric])}{f' ({len(others)})' if others else ''}"


def _errors(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Position error"
    yield ""
    yield (
        "RMSE with the values of the family, m; bold: the best and those not shown worse. In square brackets: runs "
        "that diverged. Smoothed: `imm_cv_ca` with a Rauch-Tung-Striebel smoother, which uses later measurements too. "
        "Velocity errors are in tuned.json."
    )
    yield ""
    rows = []
    for name, of in scores.items():
        best = {of["family"]["position_rmse"]["best"], *of["family"]["position_rmse"]["not worse"]}
        cells = []
        for item in (*protocol.trackers, "smoothed"):
            tracker = of["family"]["trackers"][item]
            diverged = f" [{tracker['diverged']}]" if tracker["diverged"] else ""
            cells.append(_bold(_error(tracker["position_rmse"]) + diverged, item in best))
        rows.append([name, *cells])
    yield from table(["scenario", *protocol.trackers, "smoothed"], rows)


def _covariance(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Whose covariance can be believed"
    yield ""
    yield (
        "Mean NEES with the values of the family, of which 4 is right, and the verdict on it in every condition "
        "([its words](../../docs/metrics.md)). The values are those of the smallest position error; `trackbench tune "
        "--objective likelihood` judges the covariance too."
    )
    yield ""
    rows = []
    for name, of in scores.items():
        nees = [of["family"]["trackers"][item]["nees"] for item in protocol.trackers]
        rows.append(
            [name, *(_bold(f"{item['value']:.1f} {item['verdict']}", item["verdict"] == "consistent") for item in nees)]
        )
    yield from table(["scenario", *protocol.trackers], rows)


def _regret(protocol: Protocol, scores: Scores) -> Iterator[str]:
    yield "## Error with one set of values"
    yield ""
    yield (
        "Position RMSE with the values of the family over that with the scenario's own values, on the same "
        f"measurements; above {100 * REGRET:.0f} % bold. Below zero: the scenario's own values fit the scenes that "
        "they were tuned on. Left out: a scenario that is a family by itself."
    )
    yield ""
    rows, costs = [], []
    for name, of in scores.items():
        if len(protocol.families[protocol.family_of(name)]) == 1:
            continue
        cells = [name]
        for item in protocol.trackers:
            family, own = (of[which]["trackers"][item]["position_rmse"]["value"] for which in ("family", "own"))
            costs.append((family / own - 1.0, name, item))
            cells.append(_bold(f"{family / own - 1.0:+.1%}", family / own - 1.0 > REGRET))
        rows.append(cells)
    yield from table(["scenario", *protocol.trackers], rows)
    cost, name, item = max(costs)
    yield (
        f"It is at most {100 * REGRET:.0f} % larger in {sum(of <= REGRET for of, _, _ in costs)} of {len(costs)} "
        f"cases, and {cost:.1%} at most, of {item} in {name}."
    )
    yield ""


def _values(protocol: Protocol, values: Mapping[str, Any]) -> Iterator[str]:
    yield "## The values"
    yield ""
    loaded = protocol.loaded(protocol.scenarios[0], protocol.entries)
    at_an_end = [
        f"{tracker} `{option.key}` {values[tracker][name][option.key]:.3g} ({name})"
        for tracker in protocol.trackers
        for option in protocol.parameters(tracker, loaded)
        for name in protocol.families
        if option.edge(values[tracker][name][option.key]) is not None
    ]
    yield f"All are in [values.yaml](values.yaml). At an end of the range that was searched: {', '.join(at_an_end)}."
    yield "A better one may lie beyond it."
    yield ""


def _error(error: Mapping[str, Any]) -> str:
    """ "0.106 ±0.005"."""
    low, high = error["ci95"]
    return f"{error['value']:.3f} ±{(high - low) / 2:.3f}"


def _bold(text: str, where: bool) -> str:
    return f"**{text}**" if where else text
