"""The subjects, and the table of what was measured."""

from __future__ import annotations

import importlib
import json
import pkgutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from .claim import FAILS, HOLDS, OUTCOMES, STATED, UNDECIDED, Claim

FOLDER = Path(__file__).parent
RESULTS = FOLDER.parents[1] / "results"
#: Modules that are no subjects.
OTHERS = {"__main__", "claim", "subjects", "traffic_pool"}


def subjects() -> list[str]:
    """The names of all subjects."""
    return sorted(module.name for module in pkgutil.iter_modules([str(FOLDER)]) if module.name not in OTHERS)


def measure(subject: str) -> list[Claim]:
    """The claims of one subject."""
    return list(importlib.import_module(f"{__package__}.{subject}").claims())


def load() -> dict[str, list[Claim]]:
    """What was measured before, by subject."""
    file = RESULTS / "calibration.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return {name: [Claim(**claim) for claim in claims] for name, claims in known.items()}


def save(found: Mapping[str, Sequence[Claim]]) -> None:
    """Write the table as data and as Markdown."""
    entries = {name: [_entry(claim) for claim in claims] for name, claims in found.items()}
    text = json.dumps(entries, indent=1, ensure_ascii=False) + "\n"
    (RESULTS / "calibration.json").write_text(text, encoding="utf-8")
    (RESULTS / "calibration.md").write_text("\n".join(_lines(found)), encoding="utf-8")


def _entry(claim: Claim) -> dict[str, object]:
    """Return the fields of a claim; whether it is decided only where it is not, the excess only where there is one."""
    entry = claim._asdict()
    if claim.decided:
        del entry["decided"]
    if claim.excess is None:
        del entry["excess"]
    else:
        entry["excess"] = round(claim.excess, 4)
    return entry


def worst_of_families(claims: Sequence[Claim]) -> list[tuple[Claim, int]]:
    """Return the worst claim of each family, the claims of a subject that want the same, with their number.

    What fails is worse than what is not decided, which is worse than what holds; then the excess counts. Numbers that
    are only stated have no worst one and are left out.
    """
    families: dict[str, list[Claim]] = {}
    for claim in claims:
        if claim.wanted != STATED:
            families.setdefault(claim.wanted, []).append(claim)
    order = (HOLDS, UNDECIDED, FAILS)

    def badness(claim: Claim) -> tuple[bool, int, float]:
        return not claim.holds, order.index(claim.outcome), -np.inf if claim.excess is None else claim.excess

    return [(max(family, key=badness), len(family)) for family in families.values()]


def _lines(found: Mapping[str, Sequence[Claim]]) -> Iterator[str]:
    outcomes = Counter(claim.outcome for claims in found.values() for claim in claims)
    hold, fail, undecided, stated = (outcomes[outcome] for outcome in OUTCOMES)
    yield "# Calibration"
    yield ""
    yield f"Made by `make calibration`. {hold + fail + undecided} claims: {hold} hold, {fail} do not;"
    yield f"{undecided} are not decided by so many repeats. Below is the worst claim of each kind that wants the same;"
    yield f"every claim, and {stated} numbers that are only stated, are in [calibration.json](calibration.json)."
    yield "A claim is not decided where a limit of what is wanted lies within ±."
    yield "± is the Monte-Carlo error of the measurement itself, 95 %."
    yield ""
    yield "## What does not hold"
    yield ""
    for subject, claims in found.items():
        for claim in claims:
            if claim.outcome != STATED and not claim.holds:
                begin = "Does not hold" if claim.decided else "Not decided, and measured beyond what is wanted"
                yield f"- {begin}: {subject}, {claim.what} ({claim.measured}, wanted {claim.wanted})."
    for subject, claims in found.items():
        worst = worst_of_families(claims)
        if worst:
            yield ""
            yield f"## {importlib.import_module(f'{__package__}.{subject}').__doc__}"
            yield ""
            yield "| worst claim | measured | wanted | | of |"
            yield "|---|---|---|---|--:|"
            for claim, number in worst:
                yield f"| {claim.what} | {claim.measured} | {claim.wanted} | {claim.outcome} | {number} |"
    yield ""
