"""The report of a result: one page, whose sections follow from its identities, its truth and its metrics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.subjects import collected
from trackbench.document import Block, Code, Document, Figure, Item, Items, Paragraph, Row, Section, Table, TrackerStyle
from trackbench.document.palette import tracker_styles
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.report import tables
from trackbench.report.association import against_oracle
from trackbench.report.conditions import after_jumps, condition_tables, covariance_verdict_table
from trackbench.report.figures.map import styles_with_map
from trackbench.report.figures.over_time import (
    QUANTITIES,
    error_over_time,
    gospa_over_time,
    nees_over_time,
    nis_over_time,
)
from trackbench.report.first_screen import competing, first_screen, picture
from trackbench.report.moments import events_section, moments_section, worst_moments
from trackbench.report.numbers import margin_words
from trackbench.report.pairs import Pairs, standing
from trackbench.report.scenes import (
    ONE_RUN,
    basis_of_intervals,
    scenes,
    undrawn_scenes,
    values_of_few_scenes,
    without_interval,
)
from trackbench.report.sentences import (
    FALSE_OF_REFERENCE,
    below_the_bound,
    censored,
    drawing_random,
    facts,
    made_elsewhere,
    missing_estimates,
    others_ignored,
    provenance,
    reused_identities,
    switch_cost,
)
from trackbench.report.truth_and_sensors import audit_sentences, sensor_table
from trackbench.results import Result


def result_document(result: Result) -> Document:
    """The report of a run."""
    trackers, result, summary = len(result.summary.trackers), result.listed, result.listed.summary
    styles = tracker_styles(result.places)
    shown = [styles[tracker.name] for tracker in result.drawn]
    labelled = summary.truth.known and summary.identities == "known"
    moments = worst_moments(result) if labelled else {}
    blocks = [
        Section("Verdict", tuple(first_screen(result, trackers, picture(result, shown, moments)))),
        *_sections(result, shown, moments),
        *([] if summary.passed else [Section("Expectations", tuple(_expectations(result)))]),
        Section("Truth and sensors" if summary.truth.known else "Sensors", tuple(_truth_and_sensors(result))),
        Section("How to reproduce it", tuple(_reproduction(result))),
    ]
    name, description = summary.scenario.name, summary.scenario.description
    return Document("report", name, tuple(blocks), description, facts(result, trackers), tuple(shown))


def _sections(
    result: Result, shown: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]
) -> Iterator[Section]:
    """What is between the verdict and the expectations."""
    summary, scored = result.summary, result.scored
    if not summary.truth.known:
        for title, (note, paths) in _WITHOUT_TRUTH.items():
            yield Section(title, (Paragraph(note), tables.track_table(title, scored, paths)))
        missing = ", ".join(map(tables.metric_in_words, TRACK_METRICS))
        yield Section("What cannot be told", (Paragraph(f"Not without a truth: {missing}."),))
        return
    labelled = summary.identities == "known"
    others = tables.other_metrics(result)
    if scored:
        yield _ranking(result, others)
    if len(scored) > 1:
        yield _differences(result)
    if summary.truth.scenes:
        yield Section("Scene by scene", tuple(scenes(result)))
    yield from collected("sections", result, shown)
    if labelled:
        yield from _accuracy(result, shown, moments)
        if conditions := tuple(condition_tables(result)):
            yield Section("By manoeuvre and range", (Row(conditions),))
        yield from _consistency(result, shown)
        return
    yield from _figures("What happened", [gospa_over_time(result.tables.steps, shown)])
    yield from events_section(result)
    notes = {"Errors of matched tracks": censored(result)}
    if reused := reused_identities(result):
        notes["Identity"] = f"{reused[0].upper()}{reused[1:]}. {_SAME_ID}"
    for title, paths in tables.TRACK_GROUPS.items() if scored else ():
        explained = (Paragraph(notes[title]),) if title in notes else ()
        yield Section(title, (tables.track_table(title, scored, paths), *explained))
    if others is not None:
        yield Section("Other metrics", (others,))


_SAME_ID = "Tracks of one identity are scored as one track: a second track of it on the same object is no switch."
#: The sections without a truth: title, what to know of it, and the metrics that are the columns of its table.
_WITHOUT_TRUTH: dict[str, tuple[str, tuple[str, ...]]] = {
    "Tracks": (
        "Trackers stand in the scenario's order. More or longer tracks are not better: they may be of nothing.",
        ("track_count", "new_tracks", "track_length", "used_share"),
    ),
    "Predictions": (
        "Before each scan a built-in tracker is asked where its tracks are. NIS is of the detections that they "
        "then used, so a tracker that takes only near ones has a small one. The score is of all detections of all "
        "scans: each tracker is asked the same. It tells how well the sensor's next scan is predicted, false alarms "
        "and all, and not how near the tracks are to vehicles; only differences of it mean something.",
        ("nis", "prediction_score"),
    ),
}


def _ranking(result: Result, others: Table | None) -> Section:
    summary, trackers, drawn = result.summary, result.scored, result.drawn
    references = any(tracker.is_reference for tracker in trackers)
    basis = f"Small print is the 95 % interval, {basis_of_intervals(result)}."
    if values_of_few_scenes(result):
        few = f"No interval and no verdict holds with fewer than {FEWEST_SCENES} scenes: see “Scene by scene”"
        basis = f"{few if summary.truth.scenes else ONE_RUN}."
    without = tuple(Item(f"{sentence[0].upper()}{sentence[1:]}.") for sentence in without_interval(result))
    folded = [Section("Metrics without an interval", (Items(without),), folded=True)] if without else []
    sentences = [drawing_random(result), *others_ignored(result), *made_elsewhere(result)]
    basis += "".join(f" {sentence}." for sentence in sentences if sentence)
    column = standing(result)
    shown = f"“{column.heading}”: {column.meaning}"
    if summary.identities == "hidden":
        note = f"By {summary.headline_name}. {shown}. {basis}" + (_ORACLES if references else "")
        told = (switch_cost(result), *against_oracle(result))
        return Section("Ranking", (Paragraph(note), tables.ranking_table(result), *map(Paragraph, told), *folded))
    note = (
        f"By position RMSE. {shown}. {basis}"
        + (f" Figures show the best {len(drawn)}." if len(drawn) < len(trackers) else "")
        + (f" {_SMOOTHERS}" if references else "")
    )
    sentences = missing_estimates(result) + below_the_bound(result)
    remarks = [Paragraph(". ".join(sentences) + ".")] if sentences else []
    own = [] if others is None else [Section("Other metrics", (others,))]
    return Section("Ranking", (Paragraph(note), tables.ranking_table(result), *remarks, *folded, *own))


_ORACLES = f" A reference knows which detection is whose: it is no competitor; {FALSE_OF_REFERENCE}."
_SMOOTHERS = (
    "Offline: a smoother, which knows the measurements after each instant too, and shows what was to be had from the "
    "same data. It is no competitor."
)


def _differences(result: Result) -> Section:
    """The differences of the metric that ranks."""
    summary = result.summary
    text = _DIFFERENCES.format(
        metric=summary.headline_name,
        margin=margin_words(Pairs(result).margins),
        family=_family(result),
    )
    if summary.identities == "known":
        text += _NOT_BETTER if any(item.turned for item in result.differences) else ""
        undrawn = undrawn_scenes(len(summary.truth.scenes), summary.truth.few_scenes_decide)
        text += "".join(f" {sentence}." for sentence in undrawn)
    return Section("Differences between trackers", (Paragraph(text), tables.key_differences(result)))


_DIFFERENCES = (
    "Paired differences of {metric}. Better and worse: shown to differ by more than the margin, {margin}; equivalent: "
    "within it; undecided: neither. {family} Each interval is of its pair alone."
)


def _family(result: Result) -> str:
    """Over which differences the risk of a wrong word is 5 %."""
    score, expected = result.summary.score, any(item.operator == "better_than" for item in result.summary.expectations)
    beside = " and what the expectations name" if expected else ""
    if score.best is not None:
        return (
            f"The risk is 5 % that any tracker as good as the best is called worse than {score.best}, which was chosen "
            f"from the same data: p-values are corrected for that and, after Holm, for the number of trackers{beside}."
        )
    pairs = "all pairs" if score.baseline is None else f"all trackers against {score.baseline}"
    return f"The risk that any is called so wrongly is 5 %: p-values are corrected after Holm for {pairs}{beside}."


_NOT_BETTER = (
    " Smaller and larger: shown to differ by more than the margin too, but the difference turns without what is "
    "charged for missing estimates, and neither is called better."
)


def _accuracy(
    result: Result, shown: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]
) -> Iterator[Section]:
    steps, reference = result.tables.steps, result.summary.held_against
    yield from _figures("Accuracy", [error_over_time(steps, shown, quantity, reference) for quantity in QUANTITIES])
    ringed = [style.name for style in styles_with_map(competing(result, shown))]
    yield from moments_section(result, moments, ringed)


def _consistency(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    sensors = list(enumerate(result.summary.sensors))
    figures = [
        nees_over_time(result.tables.steps, shown),
        *(nis_over_time(result.tables.nis, sensor, shown, number) for number, sensor in sensors),
    ]
    numbers = (covariance_verdict_table(result), *tables.innovation_tables(result))
    yield from _figures("Consistency", figures, numbers, _VERDICTS)


_VERDICTS = (
    "What is right: NEES 4, NIS its degrees of freedom, autocorrelation 0. trackbench explain defines each word."
)


def _figures(
    title: str, figures: Sequence[Figure | None], numbers: Sequence[Table | None] = (), text: str = ""
) -> Iterator[Section]:
    rows = [tuple(item for item in items if item) for items in (figures, numbers)]
    if any(rows):
        begin = [Paragraph(text)] if text else []
        yield Section(title, (*begin, *(Row(blocks) for blocks in rows if blocks)))


def _expectations(result: Result) -> Iterator[Block]:
    """What was expected, and what it is held against."""
    yield tables.expectation_table(result)
    if any(item.operator in ("below", "above") for item in result.summary.expectations):
        yield Paragraph(
            "“Below” and “above” hold the value against the limit, not its interval; “better than” is tested."
        )


def _truth_and_sensors(result: Result) -> Iterator[Block]:
    if result.summary.truth.known:
        yield from map(Paragraph, audit_sentences(result.summary.truth))
    if shares_of_jumps := after_jumps(result.scored):
        yield Paragraph(shares_of_jumps)
    yield sensor_table(result)
    for name, sensor in result.summary.sensors.items():
        if sensor.effects:
            yield Paragraph(f"Effects of {name}: {sensor.effects_with_options}.")


def _reproduction(result: Result) -> Iterator[Block]:
    summary, scenario = result.summary, result.summary.scenario
    if summary.command:
        yield Code(summary.command, "sh")
    yield Paragraph(f"{summary.made_with}.")
    yield Paragraph(f"Fingerprint of all measurements: {summary.fingerprint}")
    if made := provenance(result):
        yield Section("Provenance", (Items(tuple(Item(text, label) for label, text in made)),))
    yield Section("Trackers", (tables.described_trackers(result),), folded=True)
    changed = f", changed by the command: {', '.join(scenario.overrides)}" if scenario.overrides else ""
    yield Paragraph(f"The text of {scenario.file} is scenario.text in result.json{changed}.")
