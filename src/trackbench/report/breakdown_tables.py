"""Tables by manoeuvre and by range band, free of any markup."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from trackbench.report.claims import claims
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval, percent
from trackbench.report.tables import Cell, Table
from trackbench.report.wording import Tracker, scored

By = Literal["manoeuvre", "range"]
BY: tuple[By, ...] = ("manoeuvre", "range")

_NOT_MET = "no estimate of the tracker falls into it"


def classes(trackers: list[Tracker], by: By) -> list[str]:
    """Every manoeuvre or range band that any tracker met, in their order."""
    every = [list(tracker["breakdown"][by]) for tracker in trackers]
    found: list[str] = max(every, key=len, default=[])
    return found + [name for names in every for name in names if name not in found]


def errors(summary: Mapping[str, Any], by: By) -> Table:
    """Position RMSE, and below it velocity RMSE, of each tracker in each class."""
    trackers = scored(summary)
    names = classes(trackers, by)
    entries = [[tracker["breakdown"][by].get(name) for name in names] for tracker in trackers]
    known = [entry for row in entries for entry in row if entry]
    places = [decimals([e[key]["value"] for e in known]) for key in ("position_rmse", "velocity_rmse")]
    rows = [
        [Cell(tracker["name"], tracker=tracker["name"]), *(_errors(entry, places) for entry in row)]
        for tracker, row in zip(trackers, entries, strict=True)
    ]
    return Table([("tracker", ""), *((_heading(trackers, by, name), "position RMSE, m") for name in names)], rows)


def confidence(summary: Mapping[str, Any], by: By, quantity: str) -> Table:
    """Errors of ``quantity`` ("position" or "velocity") over what each tracker claims, in each class."""
    trackers = scored(summary)
    names = classes(trackers, by)
    rows = [
        [
            Cell(tracker["name"], tracker=tracker["name"]),
            *(_confidence(tracker["breakdown"][by].get(name), quantity) for name in names),
        ]
        for tracker in trackers
    ]
    return Table([(quantity, ""), *((name, "errors over the claim") for name in names)], rows)


def _heading(trackers: list[Tracker], by: By, name: str) -> str:
    """A class with the share of the best tracker's estimates that fall into it."""
    best = trackers[0]["breakdown"]
    entry = best[by].get(name)
    share = entry["count"] / best["all"]["count"] if entry else 0.0
    return f"{name}, {percent(share) if share == 0 or share >= 0.01 else f'under {percent(0.01)}'}"


def _errors(entry: Mapping[str, Any] | None, places: list[int]) -> Cell:
    if entry is None:
        return Cell(NOT_AVAILABLE, reason=_NOT_MET)
    position, velocity = entry["position_rmse"], entry["velocity_rmse"]
    spread = interval(position["ci95"], places[0])
    details = (*([spread] if spread else []), f"{fixed(velocity['value'], places[1])} m/s")
    return Cell(f"{fixed(position['value'], places[0])} m", details)


def _confidence(entry: Mapping[str, Any] | None, quantity: str) -> Cell:
    if entry is None:
        return Cell(NOT_AVAILABLE, reason=_NOT_MET)
    claim = next(claim for claim in claims(entry) if claim.quantity == quantity)
    tone = {"too confident": "bad", "too cautious": "warn"}.get(claim.fault, "")
    places = decimals([claim.ratio], 2)
    return Cell(fixed(claim.ratio, places), tuple(filter(None, (interval(claim.ci95, places), claim.fault))), tone)
