"""What every report of a run begins and ends with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Code, Document, Item, Items, Paragraph, Section, Status, TrackerStyle
from trackbench.document.palette import tracker_colours, tracker_styles
from trackbench.report.numbers import joined
from trackbench.report.run import tables
from trackbench.report.run.audit import audit_sentences
from trackbench.report.run.breakdown import after_jumps
from trackbench.report.run.sentences import expectations_met, facts, failure
from trackbench.results import Result

_Sections = Callable[[Mapping[str, TrackerStyle], Sequence[TrackerStyle]], Iterable[Section]]


def framed(
    result: Result,
    colours: Mapping[str, str] | None,
    headline: Paragraph,
    standings: Iterable[Block],
    sections: _Sections,
) -> Document:
    """The whole report.

    Args:
        result: what was found.
        colours: of every tracker of a batch of scenarios; of those of this one, in its order, unless given.
        headline: its first sentence.
        standings: who is how good.
        sections: what is special to it, from the styles of all trackers and of those that are drawn.
    """
    summary = result.summary
    styles = tracker_styles(colours or tracker_colours(tracker.name for tracker in summary.trackers))
    shown = [styles[tracker.name] for tracker in result.drawn]
    blocks = [
        Section("Verdict", tuple(_verdict(result, headline, standings))),
        *sections(styles, shown),
        *([Section("Expectations", (tables.expectations(result),))] if summary.expectations else []),
        Section("Truth and sensors", tuple(_truth_and_sensors(result))),
        Section("How to reproduce it", tuple(_reproduction(result))),
    ]
    return Document(
        "report", summary.scenario.name, tuple(blocks), summary.scenario.description, facts(result), tuple(shown)
    )


def _verdict(result: Result, headline: Paragraph, standings: Iterable[Block]) -> Iterator[Block]:
    summary, missing = result.summary, result.unscored
    yield headline
    yield Status(
        expectations_met(summary.expectations), "" if not summary.expectations else "good" if summary.passed else "bad"
    )
    if missing:
        yield Status(f"{counted(len(missing), 'tracker')} not ranked", "bad")
    yield from standings
    if missing:
        failures = tuple(Item(failure(result, tracker), tracker.name, tone="bad") for tracker in missing)
        yield Section("Not ranked", (Items(failures),))


def _truth_and_sensors(result: Result) -> Iterator[Block]:
    for sentence in audit_sentences(result.summary.truth):
        yield Paragraph(sentence)
    if shares_of_jumps := after_jumps(result.scored):
        yield Paragraph(shares_of_jumps)
    yield tables.sensors(result)


def _reproduction(result: Result) -> Iterator[Block]:
    summary, scenario = result.summary, result.summary.scenario
    if summary.command:
        yield Code(summary.command, "sh")
    yield Paragraph(f"{summary.made_with}.")
    yield from _engines(result)
    yield Paragraph(f"Fingerprint of all measurements: {summary.fingerprint}")
    overrides = [Paragraph(f"Changed by the command: {', '.join(scenario.overrides)}.")] if scenario.overrides else []
    yield Section(f"Scenario {scenario.file}", (Code(scenario.text, "yaml"), *overrides), folded=True)


def _engines(result: Result) -> Iterator[Block]:
    """Which trackers were computed by which engine, where it was not the same for all."""
    by_engine: dict[str, list[str]] = {}
    for tracker in result.summary.trackers:
        if tracker.engine is not None:
            by_engine.setdefault(tracker.engine, []).append(tracker.name)
    if len(by_engine) > 1:
        yield Paragraph(" ".join(f"Computed by {engine}: {joined(names)}." for engine, names in by_engine.items()))
