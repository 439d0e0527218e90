"""In which worlds the order of two trackers holds: a table, and what it says in a sentence."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.compare import Comparison
from trackbench.compare.comparison import OrderInWorlds
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Section, Table, Tone
from trackbench.report.numbers import joined_names
from trackbench.scenario.worlds import MEANING

_METHOD = (
    "Each cell names the tracker that is shown to be better by more than the margin in that world (5 % for all pairs "
    "and worlds of the scenario together, Holm). Turns: each of the two is ahead in some world."
)
_TONE: dict[str, Tone] = {"holds": "good", "turns": "bad", "holds in part": "warn", "not shown": ""}


def worlds_section(comparison: Comparison) -> Section:
    """Every pair of contenders whose order is shown in some world, and the number of the others."""
    parts: list[Block] = []
    for scenario in dict.fromkeys(order.scenario for order in comparison.worlds):
        orders = [order for order in comparison.worlds if order.scenario == scenario]
        shown = [order for order in orders if order.order != "not shown"]
        columns = [Column("trackers", left=True), *map(Column, orders[0].ahead), Column("order", left=True)]
        rows = [
            (
                Cell(f"{order.a}, {order.b}"),
                *(Cell(ahead or "not shown") for ahead in order.ahead.values()),
                Cell(order.order, tone=_TONE[order.order]),
            )
            for order in shown
        ]
        if shown:
            parts.append(Table(f"worlds of {scenario}", tuple(columns), tuple(rows)))
        if len(shown) < len(orders):
            number = f"{len(orders) - len(shown)} of the {len(orders)}"
            parts.append(Paragraph(f"{scenario}: for {number} pairs no order is shown in any world."))
    names = dict.fromkeys(world for order in comparison.worlds for world in order.ahead)
    items = tuple(Item(meaning, label=world) for world, meaning in MEANING.items() if world in names)
    return Section("In which worlds does it hold?", (Items(items), Paragraph(_METHOD), *parts))


def order_sentences(comparison: Comparison) -> Iterator[str]:
    """Of each scenario in several worlds: which tracker has the smallest error where, and where the best of the first
    world is ahead of its strongest rival: one that is ahead of it in some world, or else the first that is behind."""
    for scenario in dict.fromkeys(order.scenario for order in comparison.worlds):
        orders = [order for order in comparison.worlds if order.scenario == scenario]
        yield _smallest(comparison, scenario, list(orders[0].ahead))
        best = [order for order in orders if order.a == orders[0].a]
        shown = [order for order in best if order.order != "not shown"]
        yield _sentence(max(shown or best, key=lambda order: len(order.where(order.b))))


def _smallest(comparison: Comparison, scenario: str, worlds: list[str]) -> str:
    names = {name for order in comparison.worlds if order.scenario == scenario for name in (order.a, order.b)}
    where: dict[str, list[str]] = {}
    for world in worlds:
        scores = [score for score in comparison.scores if score.scenario == f"{scenario}-{world}"]
        values = {
            score.entrant.tracker: value
            for score in scores
            if score.entrant.tracker in names and (value := score.value(comparison.ranked_by)) is not None
        }
        where.setdefault(min(values, key=values.__getitem__), []).append(world)
    parts = [f"{name} in {joined_names(worlds)}" for name, worlds in where.items()]
    return f"{scenario}: smallest error of {'; '.join(parts)}."


def _sentence(order: OrderInWorlds) -> str:
    ahead, behind, neither = (order.where(name) for name in (order.a, order.b, None))
    if not ahead and not behind:
        return f"Neither of {order.a} and {order.b} is shown to be better in any of these worlds."
    where = f" ({joined_names(ahead)})" if ahead else ""
    text = f"{order.a} is ahead of {order.b} in {len(ahead)} of {len(order.ahead)} worlds{where}"
    if behind:
        text += f", behind in {joined_names(behind)}"
    if neither:
        text += f"; not shown in {joined_names(neither)}"
    return f"{text}."
