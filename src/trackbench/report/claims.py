"""How large errors are beside what a tracker claims, by manoeuvre and range band, and what may be said of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from trackbench.report.numbers import fixed, joined

#: Errors this many times as large as claimed, or the reciprocal, are worth a sentence.
NOTABLE = 1.25
#: A manoeuvre with a smaller share of the estimates is in the tables, but not in a sentence.
_SMALLEST_SHARE = 0.01

QUANTITIES = ("position", "velocity")
_PLACES = {
    "straight": "on straights",
    "accelerating": "when accelerating",
    "braking": "under braking",
    "turning": "in turns",
    "sensor gap": "in sensor gaps",
}


@dataclass(frozen=True)
class Claim:
    """Errors of one quantity in one class of estimates over what the tracker claims: the root of the mean NEES part
    over its degrees of freedom."""

    quantity: str
    ratio: float
    ci95: tuple[float, float] | None

    @property
    def fault(self) -> str:
        """ "too confident" or "too cautious" where the whole interval is beyond ``NOTABLE``, else nothing."""
        if self.ci95 is None:
            return ""
        if self.ci95[0] > NOTABLE:
            return "too confident"
        return "too cautious" if self.ci95[1] < 1 / NOTABLE else ""


def claims(entry: Mapping[str, Any]) -> list[Claim]:
    """Those of an entry of a tracker's ``breakdown``, position first."""
    return [_claim(quantity, entry[f"nees_{quantity}"]) for quantity in QUANTITIES]


def confidence(breakdown: Mapping[str, Any]) -> list[str]:
    """Clauses on where a tracker's claims are off, such as "too confident about velocity in turns (errors 1.6 times the
    claim)"; none where nothing was shown to be off by ``NOTABLE``."""
    entries = breakdown["manoeuvre"]
    smallest = _SMALLEST_SHARE * breakdown["all"]["count"]
    found = {name: claims(entry) for name, entry in entries.items() if entry["count"] >= smallest}
    faults = ("too confident", "too cautious")
    return [clause for fault in faults for clause in _clauses(fault, found, len(entries))]


def _clauses(fault: str, found: Mapping[str, Sequence[Claim]], manoeuvres: int) -> Iterator[str]:
    """One for each set of manoeuvres, of so many that there were, with the quantities that are off in it."""
    by_places: dict[tuple[str, ...], list[str]] = {}
    for index, quantity in enumerate(QUANTITIES):
        places = tuple(name for name, of in found.items() if of[index].fault == fault)
        if places:
            by_places.setdefault(places, []).append(quantity)
    for places, quantities in by_places.items():
        ratios = [claim.ratio for name in places for claim in found[name] if claim.quantity in quantities]
        extreme = max(ratios) if fault == "too confident" else min(ratios)
        limit = "" if len(ratios) == 1 else "up to " if fault == "too confident" else "down to "
        where = "" if manoeuvres == 1 else " throughout" if len(places) == manoeuvres else f" {_where(places)}"
        size = f"errors {limit}{fixed(extreme, 1)} times the claim"
        yield f"{fault} about {joined(quantities)}{where} ({size})"


def _where(places: Sequence[str]) -> str:
    return joined([_PLACES[name] for name in places])


def _claim(quantity: str, nees: Mapping[str, Any]) -> Claim:
    def ratio(mean: float) -> float:
        return math.sqrt(mean / nees["dof"])

    ci95 = nees["ci95"]
    return Claim(quantity, ratio(nees["mean"]), None if ci95 is None else (ratio(ci95[0]), ratio(ci95[1])))
