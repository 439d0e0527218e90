"""The report of a tuning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Code, Document, Item, Items, Paragraph, Row, Section, Status
from trackbench.report.numbers import joined
from trackbench.subjects.tuning.outcome import headline, remarks
from trackbench.subjects.tuning.report import tables
from trackbench.subjects.tuning.report.figures import front_figure, pair_figures, response_figure
from trackbench.subjects.tuning.response import STRONG, correlations
from trackbench.subjects.tuning.tune import Tuning

_METHOD = (
    "All trials took the same measurements. The search begins with evenly spread values, goes on where good ones are "
    "frequent (the tree-structured Parzen estimator), then follows a quadratic model around the best, and ends with "
    "each option by itself. Start and tuned values are then held against each other on other scenes or noise, run by "
    "run."
)


def tuning_document(found: Sequence[Tuning], command: str) -> Document:
    """The whole report.

    Args:
        found: of each tracker.
        command: what repeats it.
    """
    several = len(found) > 1
    blocks: list[Block] = []
    for item in found:
        inner = tuple(_tracker(item, f"{item.tracker}-" if several else ""))
        blocks += [Section(item.tracker, inner)] if several else inner
    blocks.append(Section("How it was done", (Paragraph(_METHOD), *_split(found[0]), Code(command, "sh"))))
    return Document(
        "tuning", f"Tuning of {joined([item.tracker for item in found])}", tuple(blocks), _lead(found), _facts(found)
    )


def tuning_summary(found: Sequence[Tuning]) -> Document:
    """What a terminal shows: the values, whether they are better, and how sharply they are known."""
    blocks: list[Block] = []
    for item in found:
        said = [Item(text) for text in remarks(item)]
        inner = [_status(item), tables.values(item), tables.held_out(item), *([Items(tuple(said))] if said else [])]
        blocks += [Section(item.tracker, tuple(inner))] if len(found) > 1 else inner
    return Document(
        "tuning", f"Tuning of {joined([item.tracker for item in found])}", tuple(blocks), _lead(found), _facts(found)
    )


def _lead(found: Sequence[Tuning]) -> str:
    return f"For the {found[0].objective.meaning}, in {joined(found[0].scenarios)}."


def _facts(found: Sequence[Tuning]) -> tuple[str, ...]:
    return (counted(sum(len(item.trials) for item in found), "trial"), f"objective {found[0].objective.name}")


def _status(item: Tuning) -> Block:
    text, tone = headline(item)
    return Status(text, tone)


def _tracker(item: Tuning, name: str) -> Iterator[Block]:
    yield _status(item)
    said = tuple(Item(text) for text in remarks(item))
    if said:
        yield Items(said)
    yield tables.values(item, name)
    yield Section(
        "On measurements that it was not tuned on" if any(item.apart) else "Start and tuned",
        (tables.held_out(item, name),),
    )
    if item.front:
        yield Section("The front", (Row((front_figure(item, name),)), tables.front(item, name)))
    figures = [figure for response in item.responses if (figure := response_figure(item, response, name)) is not None]
    if figures:
        around = (tables.response(item, name), Row(tuple(figures)), *_pairs(item, name))
        yield Section("The response around the optimum", around)
    yield Section("Trials", (tables.trials(item, name),), folded=True)


def _pairs(item: Tuning, name: str) -> Iterator[Block]:
    """The trials over each pair of options, and which pairs make up for each other."""
    found = correlations(item.parameters, item.trials, item.best)
    strong = [f"{a} and {b} ({value:+.2f})" for (a, b), value in found.items() if abs(value) > STRONG]
    if strong:
        yield Paragraph(
            f"Hard to tell apart: {joined(strong)}. A change of one is made up for by the other; fix one of them, or "
            "tune on measurements that tell them apart."
        )
    figures = pair_figures(item, name)
    if figures:
        yield Row(tuple(figures))


def _split(item: Tuning) -> Iterator[Block]:
    """On what it was tuned, and on what it was tried."""
    rows = []
    for number, scenario in enumerate(item.scenarios):
        trained = f"{counted(item.train_scenes[number], 'scene')} of {counted(item.train_runs[number], 'run')}"
        tried = f"{counted(item.held_out.scenes[scenario], 'scene')} of {counted(item.held_out.runs[scenario], 'run')}"
        apart = item.apart[number]
        text = f"tuned on {trained}, tried on {tried}: {apart}" if apart else f"tuned and tried on {trained}"
        rows.append(Item(text, scenario))
    yield Items(tuple(rows))
