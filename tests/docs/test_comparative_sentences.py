"""Sentences that one tracker is ahead of another: each is a verdict of a committed comparison."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.support.places import DOCS, ROOT

RESULTS = ROOT / "results"
FENCE = re.compile(r"^( *)(`{3,})[^\n]*\n.*?^\1\2$", re.MULTILINE | re.DOTALL)
END = re.compile(r"(?<=[.!?])[)*\"]*\s+(?=[\w`*(\[/\"])|:\n")
NAME = r"`?([a-z]\w*)`?"
#: A comparison with a tracker that is named; "and before `gnn`" keeps the subject of the sentence.
COMPARED = re.compile(rf"(and )?\b(ahead of|better than|beats|worse than|behind|before) {NAME}(?: and {NAME})?")
#: A comparison with nobody, such as "`ekf_cv` is 6 % ahead in position".
OPEN = re.compile(rf"(?:{NAME}|\b[Tt]he (IMMs?)) (?:is|are) [^.;:`]{{0,40}}?(?:ahead(?! of)|behind(?! `)|the best\b)")
LOSES = {"worse than", "behind"}
NEGATION = re.compile(r"\b(not|no|none|neither|nor|never)\b")


class Claim(NamedTuple):
    """One tracker said to be better than another, in a scenario or in general."""

    better: str
    worse: str
    scenario: str
    text: str


def verdicts() -> dict[tuple[str, str], set[str]]:
    """Return by better and worse tracker the scenarios of the committed results in which the product says so."""
    found: dict[tuple[str, str], set[str]] = {}
    for file in RESULTS.rglob("comparison.json"):
        for item in json.loads(file.read_text(encoding="utf-8"))["differences"]:
            pair = item["entrant"]["tracker"], item["against"]["tracker"]
            found.setdefault(pair, set()).update({item["scenario"]} if item["verdict"] == "better" else ())
            found.setdefault(pair[::-1], set()).update({item["scenario"]} if item["verdict"] == "worse" else ())
    for drivers, of in json.loads((RESULTS / "drivers" / "reversal.json").read_text(encoding="utf-8")).items():
        for item in of["differences"]:
            for pair in (item["a"], item["b"]), (item["b"], item["a"]):
                shown = item.get("verdict") == f"{pair[0]} better"
                found.setdefault(pair, set()).update({f"highway with drivers {drivers}"} if shown else ())
    return found


def units(page: str) -> Iterator[tuple[str, str]]:
    """Yield each sentence and each cell of a table, with the first cell of its row."""
    text = re.sub(r"\]\([^)]*\)", "]", FENCE.sub("", page))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    for row in rows:
        first, *cells = [cell.strip() for cell in row.strip().strip("|").split("|")]
        yield from ((first.strip("`"), cell) for cell in cells)
    prose = "\n".join(line for line in text.splitlines() if not line.startswith("|"))
    for block in re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.) ", prose):
        yield from (("", sentence) for sentence in END.split(" ".join(block.split())))


def claims(page: str, trackers: set[str]) -> Iterator[Claim]:
    """Yield what a page says of two trackers, without what it denies."""
    for scenario, text in units(page):
        if NEGATION.search(text.partition(";")[0]):
            continue
        subjects: list[str] = []
        for match in COMPARED.finditer(text):
            objects = [name for name in match.group(3, 4) if name in trackers]
            before = [name for name in re.findall(NAME, text[: match.start()]) if name in trackers]
            if not match.group(1):
                several = re.search(rf"{NAME} and {NAME}\W*$", text[: match.start()])
                pair = [name for name in several.groups() if name in trackers] if several else []
                subjects = pair if len(pair) > 1 else before[-1:]
            for subject in subjects:
                for other in objects:
                    pair_of = (other, subject) if match.group(2) in LOSES else (subject, other)
                    yield Claim(*pair_of, scenario, text)


def without_opponent(page: str, trackers: set[str]) -> Iterator[Claim]:
    """Yield what a page says of one tracker alone, which no verdict can support."""
    for scenario, text in units(page):
        for match in OPEN.finditer(text):
            name = match.group(1) or match.group(2)
            if (name in trackers or match.group(2)) and not NEGATION.search(text.partition(";")[0]):
                yield Claim(name, "", scenario, text)


def unsupported(page: str) -> list[Claim]:
    """Return what a page claims and no committed comparison shows, or one shows the other way round, or of nobody else.

    A row of a table that begins with a scenario speaks of that scenario.
    """
    shown = verdicts()
    trackers = {name for pair in shown for name in pair}
    scenarios = {scenario for of in shown.values() for scenario in of}
    wrong = [*without_opponent(page, trackers)]
    for claim in claims(page, trackers):
        of = {claim.scenario, f"traffic_{claim.scenario}"} & scenarios
        right, reverse = (shown.get(pair, set()) for pair in ((claim.better, claim.worse), (claim.worse, claim.better)))
        if not (right & of if of else right and not reverse):
            wrong.append(claim)
    return wrong


def pages() -> list[Path]:
    committed = [page for page in sorted(RESULTS.rglob("*.md")) if not (page.parent / "result.json").exists()]
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md")), *committed]


def test_no_page_says_that_a_tracker_is_ahead_without_a_committed_verdict() -> None:
    wrong = [f"{path.relative_to(ROOT)}: {claim}" for path in pages() for claim in unsupported(path.read_text("utf-8"))]
    assert wrong == []


def test_comparisons_are_found() -> None:
    """Sentences that the patterns do not find cannot be wrong."""
    page = (
        "| scenario | what |\n| :-- | :-- |\n| `cut_in` | `jipda` before `gnn` by 0.92, `gnn` before `naive` by 0.22 |"
    )
    pairs = [(claim.better, claim.worse) for claim in claims(page, {"jipda", "gnn", "naive"})]
    assert pairs == [("jipda", "gnn"), ("gnn", "naive")]


def test_a_claim_without_a_verdict_is_found() -> None:
    assert unsupported("With `human` drivers `ekf_cv` is 6 % ahead of `imm_three`.")
    assert unsupported("With `human` drivers the order turns: `ekf_cv` is 6 % ahead in position, which is shown.")
    assert unsupported("36 scenes do: the IMM is ahead with ideal drivers, `ekf_cv` with human ones.")
    assert unsupported("`raw` is better than `ekf_cv`.")
    assert unsupported("`imm_three` is worse than `raw`.")
    assert unsupported("| scenario | what |\n| :-- | :-- |\n| `cut_in` | `gnn` before `jipda` by 0.92 |")
    assert unsupported("| `tunnel_exit` | `jipda` before `gnn` by 0.1 and before `pmb` by 0.49 |")


def test_a_verdict_and_its_denial_are_no_finding() -> None:
    assert not unsupported("`imm_three` is better than `raw`.")
    assert not unsupported("`ekf_cv` is not shown better than `imm_three`.")
    assert not unsupported("| `cut_in` | `jipda` before `gnn` by 0.92, `gnn` before `naive` by 0.22 |")
