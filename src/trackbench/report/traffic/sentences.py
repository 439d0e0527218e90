"""What a report says of trackers of several objects."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.report.numbers import decimals, fixed, interval, margin_words, percent
from trackbench.report.run.pairs import Pair, Pairs
from trackbench.results import Result, TrackerResult
from trackbench.results.tracker_result import ORACLE
from trackbench.trackers.associate import COUNTING

#: The parts of GOSPA, in words.
PARTS = {"gospa_localisation": "localisation", "gospa_missed": "missed objects", "gospa_false": "false tracks"}
#: A part with more than this share of the square is what the error mostly is.
MOST = 0.5


def verdict(tracker: TrackerResult) -> str:
    """One sentence on a tracker's errors, without its name.

    For example "GOSPA 3.72 m, mostly localisation (62 % of its square; missed objects 29 %, false tracks 9 %); tracks
    94.8 % of what is due; 1.5 switches a minute of an object; NEES of matched tracks 4.9 (4 when consistent,
    95 % interval 4.2 to 5.7), 93.1 % within the 95 % bound".
    """
    gospa = _value(tracker, "gospa") or 0.0
    parts = [f"GOSPA {fixed(gospa, decimals([gospa]))} m{_parts(tracker)}"]
    if (share := _value(tracker, "matched_share")) is not None:
        parts.append(f"tracks {percent(share, 1)} of what is due")
    if (rate := _value(tracker, "id_switches")) is not None:
        parts.append(f"{_rate(rate, 'switch')} a minute of an object{_cost_of_switches(tracker)}")
    if rate := _value(tracker, "false_tracks"):
        parts.append(f"{_rate(rate, 'track')} a minute that never are on an object")
    if (nees := _value(tracker, "nees")) is not None:
        ci95, inside = tracker.metrics["nees"].ci95, _value(tracker, "nees_inside")
        bounds = f", 95 % interval {interval(ci95, 1)}" if ci95 else ""
        mean = f"NEES of matched tracks {fixed(nees, 1)} (4 when consistent{bounds})"
        parts.append(f"{mean}, {percent(inside, 1)} within the 95 % bound")
    if tracker.health.reused_ids:
        parts.append(f"identities used again {counted(tracker.health.reused_ids, 'time')}")
    return "; ".join(parts)


def censored(result: Result) -> str:
    """What errors of matched tracks leave out."""
    reach = (result.summary.score.cutoff_m or 0.0) / 2
    return (
        f"Errors and NEES are of tracks within {reach:g} m of their object (half of score.cutoff_m): where it is "
        "larger the object is lost and the track false, so a smaller cutoff makes them smaller."
    )


def reused_identities(result: Result) -> str:
    """Which trackers gave an identity to a second track; empty where none did."""
    found = [
        f"{tracker.name} {counted(tracker.health.reused_ids, 'time')}"
        for tracker in result.scored
        if tracker.health.reused_ids
    ]
    return f"identities used again after their track had ended: {', '.join(found)}" if found else ""


def association_against_filtering(result: Result) -> Iterator[str]:
    """What the oracles say: how much of the error is left when it is known which detection is whose.

    An oracle confirms and deletes tracks by counting, and is held against methods alone that do so too.
    """
    pairs, scored = Pairs(result.summary), result.scored
    for oracle in (tracker for tracker in scored if tracker.association == ORACLE):
        others = [
            other
            for other in scored
            if other.association in COUNTING and other.association != ORACLE and other.describe == oracle.describe
        ]
        found = pairs.get(others[0].name, oracle.name) if others else None
        if found is not None:
            yield _against_oracle(oracle, others[0].name, found, margin_words(result.summary.score.margin, "m"))


def _against_oracle(oracle: TrackerResult, best: str, found: Pair, margin: str) -> str:
    places = decimals([(found.ci95[1] - found.ci95[0]) / 2] if found.ci95 else [found.value], 1)
    value = fixed(oracle.metrics["gospa"].value, places)
    bounds = f" (95 % interval of the difference {interval(found.ci95, places)} m)" if found.ci95 else ""
    known = f"{oracle.name} knows which detection is whose: its GOSPA of {value} m is left by filtering and by how "
    known += "tracks begin and end"
    what = {
        "worse": f"Association costs {best} {fixed(found.value, places)} m more{bounds}",
        "better": f"{best} is {fixed(-found.value, places)} m below it{bounds}: association is not what limits it",
        "equivalent": f"{best} is equivalent to it{bounds}: association is not what limits it",
    }.get(found.verdict, f"Whether {best} differs from it is undecided{bounds}{_why_undecided(found, margin)}")
    return f"{known}. {what}."


def _why_undecided(found: Pair, margin: str) -> str:
    """Where the interval alone would say that there is a difference."""
    least = 0.0 if found.ci95 is None else max(found.ci95[0], -found.ci95[1])
    if least > found.margin:
        return (
            ": the interval is of this pair alone, and Holm's correction for the number of pairs does not let it count"
        )
    return f": it is not shown to be more than {margin}" if least > 0 else ""


def _parts(tracker: TrackerResult) -> str:
    """Of what the square of GOSPA is made."""
    squares = {words: (_value(tracker, path) or 0.0) ** 2 for path, words in PARTS.items()}
    total = sum(squares.values())
    if not total:
        return ""
    ordered = sorted(squares, key=lambda words: -squares[words])
    share = {words: percent(squares[words] / total) for words in ordered}
    rest = ", ".join(f"{words} {share[words]}" for words in ordered[1:])
    most = "mostly" if squares[ordered[0]] > MOST * total else "the largest part"
    return f", {most} {ordered[0]} ({share[ordered[0]]} of its square; {rest})"


def _cost_of_switches(tracker: TrackerResult) -> str:
    """Where switches cost more than any part of GOSPA."""
    switch = _value(tracker, "gospa_switch") or 0.0
    most = max(_value(tracker, path) or 0.0 for path in PARTS)
    return ", which cost more than all else" if switch > most else ""


def _rate(value: float, what: str) -> str:
    plural = {"switch": "switches", "track": "tracks"}[what]
    return f"{fixed(value, 1)} {plural}" if value >= 0.05 or not value else f"{value:.1g} {plural}"


def _value(tracker: TrackerResult, path: str) -> float | None:
    return tracker.metrics[path].value if path in tracker.metrics else None
