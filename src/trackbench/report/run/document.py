"""The report of a run, and what every report of a run begins and ends with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.document import (
    Block,
    Code,
    Document,
    Figure,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    TrackerStyle,
)
from trackbench.document.palette import tracker_colours, tracker_styles
from trackbench.metrics.differences import SILENCE
from trackbench.metrics.verdicts import ABOVE, BELOW, SMALLEST_SHARE, TOLERANCE, WHITENESS_TOLERANCE
from trackbench.report.numbers import joined, margin_words, percent
from trackbench.report.run import tables
from trackbench.report.run.calibration import (
    BY,
    LIMITS,
    QUANTITIES,
    TITLE,
    after_jumps,
    calibrations,
    classes,
    errors,
    shares,
)
from trackbench.report.run.figures.accuracy import cost_against_accuracy, error_over_time, errors_by_class, spread
from trackbench.report.run.figures.map import map_of_run, mapped
from trackbench.report.run.figures.over_time import autocorrelation, modes_over_time, nees_over_time, nis_over_time
from trackbench.report.run.scenes import basis_of_intervals, moments_section, scenes, worst_moments
from trackbench.report.run.sentences import (
    audit_sentences,
    common,
    expectations_met,
    facts,
    failure,
    headline,
    not_called_better,
    verdict,
)
from trackbench.results import Result, TrackerResult

_MakeSections = Callable[[Mapping[str, TrackerStyle], Sequence[TrackerStyle]], Iterable[Section]]


def framed(
    result: Result,
    colours: Mapping[str, str] | None,
    headline: Paragraph,
    standings: Iterable[Block],
    sections: _MakeSections,
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
        Section("Verdict", tuple(_verdict_blocks(result, headline, standings))),
        *sections(styles, shown),
        *([Section("Expectations", (tables.expectations(result),))] if summary.expectations else []),
        Section("Truth and sensors", tuple(_truth_and_sensors(result))),
        Section("How to reproduce it", tuple(_reproduction(result))),
    ]
    return Document(
        "report", summary.scenario.name, tuple(blocks), summary.scenario.description, facts(result), tuple(shown)
    )


def _verdict_blocks(result: Result, headline: Paragraph, standings: Iterable[Block]) -> Iterator[Block]:
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
    by_engine: dict[str, list[str]] = {}
    for tracker in summary.trackers:
        if tracker.engine is not None:
            by_engine.setdefault(tracker.engine, []).append(tracker.name)
    if len(by_engine) > 1:
        yield Paragraph(" ".join(f"Computed by {engine}: {joined(names)}." for engine, names in by_engine.items()))
    yield Paragraph(f"Fingerprint of all measurements: {summary.fingerprint}")
    overrides = [Paragraph(f"Changed by the command: {', '.join(scenario.overrides)}.")] if scenario.overrides else []
    yield Section(f"Scenario {scenario.file}", (Code(scenario.text, "yaml"), *overrides), folded=True)


def standings(
    result: Result, sentence: Callable[[TrackerResult], str], description: Callable[[TrackerResult], str]
) -> Iterator[Block]:
    """The ranked trackers with a sentence and a description each, then the references."""
    items = {
        t.name: Item(
            f"{sentence(t)}.", t.name + (f" ({t.reference_kind})" if t.is_reference else ""), description(t), t.name
        )
        for t in result.scored
    }
    ranked = [tracker.name for tracker in result.contenders]
    if items:
        yield Items(tuple(items[name] for name in ranked), numbered=True)
        if len(ranked) < len(items):
            yield Items(tuple(item for name, item in items.items() if name not in ranked))


def differences_section(
    result: Result, styles: Mapping[str, TrackerStyle], pairs_title: str = "All pairs", note: str = ""
) -> Iterator[Section]:
    """The differences of the metric that ranks, with the computing time; none of a single tracker."""
    if len(result.scored) < 2:
        return
    cost = cost_against_accuracy(result.drawn, styles, result.summary.headline)
    beside = Row((tables.key_differences(result), *([cost] if cost else [])))
    pairs = Section(pairs_title, (tables.all_differences(result, result.drawn),), folded=True)
    margin = margin_words(result.summary.score.margin, "m")
    text = DIFFERENCES.format(metric=result.summary.headline_name, margin=margin) + note
    yield Section("Differences between trackers", (Paragraph(text), beside, pairs))


DIFFERENCES = (
    "Differences of {metric}, paired: every tracker saw the same truth and the same noise. Negative means smaller "
    "errors. Better and worse: shown to differ by more than {margin}, the larger of the two (5 % level, corrected for "
    "the number of pairs after Holm); equivalent: the interval lies within that margin; undecided: neither, more runs "
    "or scenes would tell. Each interval is that of its pair alone, without the correction."
)
_NOT_BETTER = (
    " Smaller and larger: shown to differ by more than the margin too, but the one with the smaller errors gave over "
    f"{percent(SILENCE)} fewer estimates, and is not called better."
)
_MANOEUVRES = (
    "An object turns where its heading changes by more than 3° a second, brakes or accelerates where its speed changes "
    "by more than 1 m/s each second, both over half a second, and is in a sensor gap where no sensor of the tracker "
    "could see it for more than three periods of the slowest one; each estimate counts once, for the last of these "
    "that applies. The range is the distance from the observer. The first second begins when a sensor could first see "
    "the object."
)
SMOOTHERS = (
    "Offline: a smoother, which knows the measurements after each instant too, and shows what was to be had from the "
    "same data. It is no competitor."
)
_CALIBRATION = (
    "RMS error over the standard deviation that the tracker's covariance states: 1 is right, 2 means errors twice as "
    f"large as stated. Optimistic is a ratio whose whole 95 % interval is above {LIMITS[1]:.2f}, pessimistic one below "
    f"{LIMITS[0]:.2f}."
)

_VERDICTS = (
    f"Consistent: the 95 % interval of the mean is within {percent(TOLERANCE)} of what is right; optimistic above, "
    f"pessimistic below, undecided where it is neither. The NEES must be so under each condition too, from "
    f"{percent(BELOW)} below to {percent(ABOVE)} above, if the condition has {percent(SMALLEST_SHARE)} of the "
    "estimates; mixed: it is under some conditions and not under others. Innovations are white where the interval of "
    f"their autocorrelation is within {WHITENESS_TOLERANCE} of zero, coloured where it is beyond."
)


def run_document(result: Result, colours: Mapping[str, str] | None = None) -> Document:
    """The report of a run.

    Args:
        result: what was found.
        colours: of every tracker of a batch of scenarios; of those of this one, in its order, unless given.
    """

    def sections(styles: Mapping[str, TrackerStyle], shown: Sequence[TrackerStyle]) -> Iterator[Section]:
        yield from _scores(result, styles)
        if result.summary.truth.scenes:
            yield Section("Scene by scene", tuple(scenes(result)))
        yield from _accuracy(result, shown)
        yield from _figures("Modes", [modes_over_time(result)])
        yield from _breakdown(result, styles)
        yield from _consistency(result, shown)

    def sentence(tracker: TrackerResult) -> str:
        return verdict(tracker, result.summary.runs, result.summary.held_against.label)

    lead = Paragraph(headline(result), strong=True)
    return framed(result, colours, lead, standings(result, sentence, lambda tracker: tracker.describe), sections)


def _scores(result: Result, styles: Mapping[str, TrackerStyle]) -> Iterator[Section]:
    trackers = result.scored
    if not trackers:
        return
    margin, drawn = margin_words(result.summary.score.margin, "m"), result.drawn
    uncounted = not_called_better(result)
    legend = Paragraph(
        f"By position RMSE. No difference over {margin} was shown between trackers that share a letter under “group”"
        f"{''.join(f', {line}' for line in uncounted)}. "
        f"Small print is the 95 % interval, {basis_of_intervals(result)}.{common(result)}"
        + (f" Figures show the best {len(drawn)}." if len(drawn) < len(trackers) else "")
        + (f" {SMOOTHERS}" if any(tracker.is_reference for tracker in trackers) else "")
    )
    others = tables.other_metrics(result)
    more = Section(
        f"Errors along each axis, and the {result.summary.held_against.label}",
        (tables.axes_and_reference(result),),
        folded=True,
    )
    own = [] if others is None else [Section("Other metrics", (others,))]
    yield Section("Ranking", (legend, tables.ranking(result), *own, more))
    title = "All pairs" if len(drawn) == len(trackers) else f"All pairs of the best {len(drawn)}"
    yield from differences_section(result, styles, title, _NOT_BETTER if uncounted else "")


def _accuracy(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    steps, reference = result.tables.steps, result.summary.held_against
    moments, run = worst_moments(result), result.summary.recorded_run
    names = [tracker.name for tracker in result.contenders]
    competing = [style for style in shown if style.name in names]
    figures = [
        *(error_over_time(steps, shown, quantity, reference) for quantity in QUANTITIES),
        spread(steps, shown, reference.label),
        map_of_run(result.tables, run, competing, moments),
    ]
    yield from _figures("Accuracy", figures)
    yield from moments_section(moments, run, [style.name for style in mapped(competing)])


def _breakdown(result: Result, styles: Mapping[str, TrackerStyle]) -> Iterator[Section]:
    trackers = [tracker for tracker in result.scored if tracker.breakdown is not None]
    if not trackers:
        return
    # Where the first second is not scored, there is nothing to break down by age.
    known = [by for by in BY if by != "age" or len(classes(trackers, by)) > 1]
    drawn = [tracker for tracker in result.drawn if tracker.breakdown is not None]
    figures = [errors_by_class(drawn, styles, by, quantity) for quantity in QUANTITIES for by in known]
    numbers = [
        Section(
            f"Errors by {TITLE[by]} in numbers",
            (Paragraph(shares(trackers[0], by)), *(errors(trackers, by, quantity) for quantity in QUANTITIES)),
            folded=True,
        )
        for by in known
    ]
    calibration = [
        Section(
            f"Calibration by {TITLE[by]}",
            (
                *([Paragraph(_CALIBRATION)] if by == BY[0] else []),
                Row(tuple(calibrations(trackers, by, quantity) for quantity in QUANTITIES)),
            ),
            folded=by != BY[0],
        )
        for by in known
    ]
    row = Row(tuple(figure for figure in figures if figure))
    yield Section("By manoeuvre and range", (Paragraph(_MANOEUVRES), row, *calibration, *numbers))


def _consistency(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    sensors = list(enumerate(result.summary.sensors))
    figures = [
        nees_over_time(result.tables.steps, shown),
        *(nis_over_time(result.tables.nis, sensor, shown, number) for number, sensor in sensors),
        *(autocorrelation(result.tables.autocorrelation, sensor, shown, number) for number, sensor in sensors),
    ]
    yield from _figures(
        "Consistency", figures, (tables.nees_by_condition(result), *tables.innovations(result)), _VERDICTS
    )


def _figures(
    title: str, figures: Sequence[Figure | None], numbers: Sequence[Table | None] = (), text: str = ""
) -> Iterator[Section]:
    rows = [tuple(item for item in items if item) for items in (figures, numbers)]
    if any(rows):
        begin = [Paragraph(text)] if text else []
        yield Section(title, (*begin, *(Row(blocks) for blocks in rows if blocks)))
