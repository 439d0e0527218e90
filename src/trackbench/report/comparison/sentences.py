"""First sentences of a comparison: failed limits, the best tracker, and its lead in each world (drivers, sensors)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.compare import Comparison, Entrant, PairDifference
from trackbench.compare.differences import differences_to
from trackbench.compare.limits import limits_in_words
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Status, Table, Tone
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, VERDICTS
from trackbench.report.comparison.figures import competitors
from trackbench.report.numbers import NOT_AVAILABLE, decimals, half_width, short, signed
from trackbench.report.pairs import difference_word
from trackbench.report.verdicts import COMPARED
from trackbench.results.tracker_result import BEATS_BOUND
from trackbench.scenario.worlds import MEANING

#: Names of the metrics that rank.
NAMES = {"position_rmse": "position RMSE", "tgospa": "T-GOSPA"}
#: Differences of one verdict that a sentence lists.
LISTED = 3


def gate_items(comparison: Comparison) -> tuple[Item, ...]:
    """Return a list entry for each limit on regressions that is broken or undecided, broken limits first."""
    place = "{0.scenario}, " if len(comparison.scenarios) > 1 else ""
    return tuple(
        Item(
            f"{place}{{1}}, {{0.metric}}: {{0.text}}".format(item, entrant_name(comparison, item.entrant)),
            label="NOT SHOWN TO BE KEPT" if item.outcome == "undecided" else item.outcome.upper(),
            tone="warn" if item.outcome == "undecided" else "bad",
        )
        for item in sorted(comparison.gates, key=lambda item: item.outcome == "undecided")
        if item.outcome != "passed"
    )


def answer_blocks(comparison: Comparison) -> Iterator[Block]:
    """Yield the answer: whether limits are kept, and for each metric which tracker is best or what has changed."""
    if comparison.gates:
        yield Status(limits_in_words(comparison.outcomes), "good" if comparison.passed else "bad")
    if not_kept := gate_items(comparison):
        yield Items(not_kept)
    failures = _failures(comparison)
    for metric, items in comparison.by_metric():
        name, against = NAMES.get(metric, metric), shown_against(comparison, items)
        if against is None:
            text = f"{name}: {_changes(comparison, items)}"
        elif against == comparison.baseline:
            text = f"{name} against {against}: {_changes(comparison, differences_from(against, items))}"
        else:
            text = f"{name}: {_best(comparison, against, items)}"
        yield Paragraph(f"{failures}By {text}", strong=True)
        failures = ""
    if failures:
        yield Paragraph(failures.strip(), strong=True)


def _failures(comparison: Comparison) -> str:
    """Return a sentence on trackers without a score, such as "mine failed in B. "."""
    parts = []
    for score in (score for score in comparison.scores if score.failure):
        places = [set_letter(score.entrant.set)] if len(comparison.sets) > 1 else []
        places += [score.scenario] if len(comparison.scenarios) > 1 else []
        failure = "beats the Cramér-Rao bound" if BEATS_BOUND in score.failure else "failed"
        parts.append(f"{score.entrant.tracker} {failure}{' in ' * bool(places)}{', '.join(places)}")
    return f"{', '.join(parts[:LISTED])}{number_left_out(parts)}. " if parts else ""


def shown_against(comparison: Comparison, items: Sequence[PairDifference]) -> str | None:
    """Return the tracker, baseline or best, from which the report states the differences ``items`` of a single set.

    Return None for several sets, or if it is unknown whether smaller or larger values are better.
    """
    if len(comparison.sets) > 1:
        return None
    compared = {entrant.tracker for item in items for entrant in (item.entrant, item.against)}
    return comparison.baseline if comparison.baseline in compared else best_tracker(comparison, items)


def best_tracker(comparison: Comparison, items: Sequence[PairDifference]) -> str | None:
    """Return the competing tracker with the best value of the metric of ``items``, differences in one scenario.

    Return None if it is unknown whether smaller or larger values are better.
    """
    sign = _better_sign(comparison, items)
    if sign is None:
        return None
    values = {item.entrant.tracker: item.value for item in items}
    values |= {item.against.tracker: item.reference for item in items}
    names = [item.tracker for item in competitors(comparison) if item.tracker in values] or [*values]
    return min(names, key=lambda name: sign * values[name])


def _better_sign(comparison: Comparison, items: Sequence[PairDifference]) -> float | None:
    """Return 1 if smaller values of the metric of ``items`` are better, -1 if larger; None if unknown."""
    shown = next((item for item in items if item.verdict in ("better", "worse")), None)
    if shown is None:
        return 1.0 if items[0].metric == comparison.ranked_by else None
    return 1.0 if (shown.difference < 0) == (shown.verdict == "better") else -1.0


def differences_from(against: str, items: Sequence[PairDifference]) -> list[PairDifference]:
    """Return the difference of each other tracker from the tracker ``against``, smallest magnitude first."""
    return sorted(differences_to(against, items), key=lambda item: abs(item.difference))


def _best(comparison: Comparison, best: str, items: Sequence[PairDifference]) -> str:
    """Return a sentence: the best tracker, how far the next competitor is behind, and which others are worse."""
    differences, names = differences_from(best, items), [item.tracker for item in competitors(comparison)]
    behind = [item for item in differences if item.entrant.tracker in names] or differences
    following = behind[0]
    text = COMPARED["best"].format(
        best=best,
        end="smallest" if _better_sign(comparison, items) == 1.0 else "largest",
        value=f"{short(following.reference, difference_decimals(behind))}{unit_after(following.unit)}",
        following=_changed(following.entrant.tracker, behind, following),
        word=difference_word(following.verdict),
    )
    worse = [item for item in behind[1:] if item.verdict == "worse"]
    listed = ", ".join(_changed(item.entrant.tracker, behind, item) for item in worse[:LISTED])
    return f"{text} {COMPARED['worse'].format(listed=listed + number_left_out(worse))}" if worse else text


def _changes(comparison: Comparison, items: Sequence[PairDifference]) -> str:
    """Return a sentence: which trackers are worse, better or neither against the baseline, largest changes first."""
    parts = []
    for verdict in sorted(VERDICTS, key=["worse", "better", "larger", "smaller", UNDECIDED, EQUIVALENT].index):
        changes = [item for item in items if item.verdict == verdict]
        changes.sort(key=lambda item: -abs(item.percent or 0.0))
        listed = ", ".join(_changed(difference_subject(comparison, item), items, item) for item in changes[:LISTED])
        listed += number_left_out(changes)
        if verdict == EQUIVALENT:
            same = sum(item.identical for item in changes)
            number = "" if same == len(changes) else f"{same} "
            listed = f"{len(changes)}{f' ({number}the same in every run)' if same else ''}"
        parts += [f"{difference_word(verdict)}: {listed}"] if changes else []
    return f"{'; '.join(parts)}."


def number_left_out(items: Sequence[object]) -> str:
    """Return how many items a list in a sentence leaves out, as " and 2 more"; empty if it leaves out none."""
    return f" and {len(items) - LISTED} more" if len(items) > LISTED else ""


def _changed(subject: str, items: Sequence[PairDifference], item: PairDifference) -> str:
    """Return ``item`` as "ekf_cv +0.0152 ±0.0068 m (+16 %)", with the decimals that all ``items`` share."""
    digits, half = difference_decimals(items), half_width(item.ci95)
    width = "" if half is None else f" ±{short(half, digits)}"
    sign = "+" if item.difference > 0 else ""
    share = "" if item.percent is None else f" ({in_percent(item.percent)} %)"
    return f"{subject} {sign}{short(item.difference, digits)}{width}{unit_after(item.unit)}{share}"


def unit_after(unit: str) -> str:
    """Return a unit as it follows a value, " m"; empty for a quantity without unit."""
    return "" if unit == "1" else f" {unit}"


def difference_decimals(items: Sequence[PairDifference]) -> int:
    """Return how many decimals show all values to three digits and the smallest interval's half width to one digit."""
    widths = [half for item in items if not item.identical and (half := half_width(item.ci95)) is not None]
    return max(decimals([item.value for item in items]), decimals(widths, 1) if widths else 0)


def in_percent(value: float | None) -> str:
    """Return a percentage with its sign, without "%"; "n/a" for None."""
    if value is None:
        return NOT_AVAILABLE
    return signed(value, 1 if abs(value) < 10 else 0)


def difference_subject(comparison: Comparison, item: PairDifference) -> str:
    """Return the tracker's name of a difference; if there are several scenarios, with the scenario's name."""
    place = f" in {item.scenario}" if len(comparison.scenarios) > 1 else ""
    return f"{entrant_name(comparison, item.entrant)}{place}"


def entrant_name(comparison: Comparison, entrant: Entrant, other: Entrant | None = None) -> str:
    """Return the shortest name (tracker, letter of its set) that tells a tracker from all others, or from ``other``."""
    if len(comparison.sets) == 1:
        return entrant.tracker
    if other is not None and entrant.tracker == other.tracker:
        return set_letter(entrant.set)
    return f"{entrant.tracker} {set_letter(entrant.set)}"


def set_letter(number: int) -> str:
    """Return the letter of the set of results with index ``number``: 0 is "A"; from index 26 on, "27" and so on."""
    return chr(ord("A") + number) if number < 26 else str(number + 1)


_TONE: dict[str, Tone] = {"holds": "good", "turns": "bad", "holds in part": "warn", "not shown": ""}


def world_tables(comparison: Comparison) -> Iterator[Table]:
    """Yield a table for each scenario in several worlds (drivers, sensors): each pair's better tracker in each."""
    meanings = {str(world): meaning for world, meaning in MEANING.items()}
    for scenario in dict.fromkeys(order.scenario for order in comparison.worlds):
        orders = [order for order in comparison.worlds if order.scenario == scenario]
        # Where nothing is shown, every pair is listed.
        shown = [order for order in orders if order.order != "not shown"] or orders
        columns = [
            (Column("trackers", left=True), [Cell(f"{order.a}, {order.b}") for order in shown]),
            *(
                (Column(world, meanings.get(world, "")), [Cell(order.ahead[world] or "not shown") for order in shown])
                for world in orders[0].ahead
            ),
            (Column("order", left=True), [Cell(order.order, tone=_TONE[order.order]) for order in shown]),
        ]
        left_out = f": {len(orders) - len(shown)} of the {len(orders)} pairs are not shown in any world"
        caption = f"Tracker shown to be better in each world of {scenario}{left_out * (len(shown) < len(orders))}"
        yield Table.of_columns(f"worlds of {scenario}", columns, caption)
