"""What a report says of trackers of several objects."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.report.numbers import decimals, fixed, interval, percent
from trackbench.report.run.pairs import Pairs
from trackbench.results import Result, TrackerResult
from trackbench.results.summary import ORACLE
from trackbench.words import counted

#: The parts of GOSPA, in words.
PARTS = {"gospa_localisation": "localisation", "gospa_missed": "missed objects", "gospa_false": "false tracks"}
#: A part with more than this share of the square is what the error mostly is.
MOST = 0.5


def verdict(tracker: TrackerResult) -> str:
    """One sentence on a tracker's errors, without its name.

    For example "GOSPA 3.72 m, mostly localisation (62 % of its square; missed objects 29 %, false tracks 9 %); tracks
    94.8 % of what is due; 1.5 switches a minute of an object; NEES of matched tracks 4.9 where 4 is right".
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
        parts.append(f"NEES of matched tracks {fixed(nees, 1)} where 4 is right")
    if tracker.health.reused_ids:
        parts.append(f"identities used again {counted(tracker.health.reused_ids, 'time')}")
    return "; ".join(parts)


def association_against_filtering(result: Result) -> Iterator[str]:
    """What the oracles say: how much of the error is left when it is known which detection is whose."""
    pairs, scored = Pairs(result.summary), result.scored
    for oracle in scored:
        if oracle.association != ORACLE:
            continue
        others = [
            other for other in scored if other.association not in (None, ORACLE) and other.describe == oracle.describe
        ]
        if not others:
            continue
        best, metric = others[0], oracle.metrics["gospa"]
        found = pairs.get(best.name, oracle.name)
        if found is None:
            continue
        places = decimals([(found.ci95[1] - found.ci95[0]) / 2] if found.ci95 else [found.value], 1)
        known = (
            f"{oracle.name} knows which detection is whose: its GOSPA of {fixed(metric.value, places)} m is left by "
        )
        known += "filtering and by how tracks begin and end"
        bounds = f" (95 % interval of the difference {interval(found.ci95, places)} m)" if found.ci95 else ""
        what = {
            "worse": f"Association costs {best.name} {fixed(found.value, places)} m more{bounds}",
            "better": f"{best.name} is {fixed(-found.value, places)} m below it{bounds}: its tracks begin and end at "
            "better times, and association is not what limits it",
            "equivalent": f"{best.name} is equivalent to it{bounds}: association is not what limits it",
        }.get(found.verdict, f"Whether association costs {best.name} anything is undecided{bounds}")
        yield f"{known}. {what}."


def _parts(tracker: TrackerResult) -> str:
    """Of what the square of GOSPA is made."""
    squares = {words: (_value(tracker, path) or 0.0) ** 2 for path, words in PARTS.items()}
    total = sum(squares.values())
    if not total:
        return ""
    ordered = sorted(squares, key=lambda words: -squares[words])
    share = {words: percent(squares[words] / total) for words in ordered}
    rest = ", ".join(f"{words} {share[words]}" for words in ordered[1:])
    most = "mostly" if squares[ordered[0]] > MOST * total else "most of it"
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
