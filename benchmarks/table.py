"""The benchmark's figures as Markdown."""

from __future__ import annotations

from typing import Any

from benchmarks.table_cells import digits, goals, met
from benchmarks.table_stages import compiling, stages

from benchmarks import growth, sensing, whole_run

#: Of what can be measured by itself, where it stands on the page.
TITLES = {
    "whole_run": "What a user pays",
    "filters": "Filters",
    "sensing": "Sensing",
    "traffic_trackers": "Tracking in traffic",
    "languages": "A tracker in another language",
    "growth": "How it grows",
    "stages": "Where the time goes",
}


def markdown(found: dict[str, Any]) -> str:
    """The tables that are written beside ``benchmark.json``."""
    again: dict[str, list[str]] = {}
    for part, place in found.get("again", {}).items():
        again.setdefault(where(place), []).append(TITLES.get(part, part))
    return "\n".join(
        [
            "# Benchmark",
            "",
            f"Made by `make benchmark`. {where(found)}.",
            "",
            *(
                line
                for place, parts in again.items()
                for line in (f"Measured again later, on another machine ({place}): {', '.join(parts)}.", "")
            ),
            whole_run.section(found["whole_run"]),
            filters(found["filters"]),
            sensing.section(found["sensing"]),
            *([memory(found["memory"])] if found["memory"] else []),
            traffic_trackers(found["traffic_trackers"]),
            traffic_scores(found["traffic_scores"]),
            isolation(found["isolation"]),
            languages(found["languages"]),
            *([growth.section(found["growth"])] if "growth" in found else []),
            *([compiling(found["stages"]), stages(found["stages_before"], found["stages"])] if found["stages"] else []),
        ]
    )


def where(place: dict[str, Any]) -> str:
    """The machine and the versions."""
    machine, versions = place["machine"], place["versions"]
    packages = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"{machine['cpu']}, one thread, Python {machine['python']}, {packages}"


def filters(found: dict[str, Any]) -> str:
    """Both engines of trackbench beside others, as a section."""
    problem = found["problem"]
    time = {(row["problem"], row["engine"]): row["value"] for row in found["microseconds_per_step"]}
    apart = {(row["problem"], row["engine"]): row["value"] for row in found["largest_difference"]}
    others = [engine for engine in dict.fromkeys(engine for _, engine in apart) if "numpy" not in engine]

    def times(name: str, ours: str, other: str) -> str:
        return f"({digits(time[name, other] / time[name, ours])} times)" if (name, other) in time else ""

    def beside(name: str, ours: str, other: str) -> str:
        return f"{digits(time[name, other])} {times(name, ours, other)}" if (name, other) in time else ""

    def share(name: str, engine: str) -> str:
        return f"{100 * (1 - time[name, engine] / time[name, f'{engine}, scored']):.0f} %"

    def rows(name: str) -> list[str]:
        scored = "fused, scored"
        alone = [digits(time[name, "fused"]), *(beside(name, "fused", other) for other in ("numpy", *others))]
        both = [digits(time[name, scored]), beside(name, scored, "numpy, scored")]
        both += [times(name, scored, other) for other in others]
        shares = f"{share(name, 'fused')}, {share(name, 'numpy')}"
        return [f"| {name} | {' | '.join(alone)} |  |", f"| with scoring | {' | '.join(both)} | {shares} |"]

    names = list(dict.fromkeys(name for name, _ in time))
    return "\n".join(
        [
            "## Filters",
            "",
            f"The same measurements for all: {problem['steps']} measurements of one weaving target, radar and lidar in "
            f"turn, in {problem['runs']} Monte-Carlo runs; FilterPy and Stone Soup take the first "
            f"{problem['peer_runs']} of them. Microseconds for a step of one run, which is the prediction to a "
            "measurement and the update with it; in brackets how many times as long as by the fused engine. With "
            "scoring: every estimate and innovation is scored too, which the others do not do; the last column is the "
            f"share of scoring in both. Best of {problem['repetitions']} repetitions in which the engines take turns. "
            "The filters in C++ take one run after the other by matrices of fixed size, compiled with `-O3 "
            "-march=native`.",
            *(
                ["", f"Nothing is compared with C++ and Eigen: {found['without_eigen']}."]
                if found["without_eigen"]
                else []
            ),
            "",
            f"| | fused | NumPy | {' | '.join(others)} | scoring: fused, NumPy |",
            f"|---|---:|---:|{'---:|' * len(others)}---:|",
            *(row for name in names for row in rows(name)),
            "",
            "The UKF of the others adds the process noise to the predicted covariance; the augmented one, which "
            "spreads sigma points over it, is trackbench's default.",
            "",
            *goals(found["goals"]),
            "",
            "Before anything is timed all estimates are compared, every component at every step. Largest difference of "
            "the fused engine from NumPy, of the estimates in standard deviations, and of the sums of a run's scores "
            "relative to the largest:",
            "",
            "| | estimates | scores |",
            "|---|---:|---:|",
            *(f"| {name} | {apart[name, 'numpy']:.1e} | {apart[name, 'numpy, scored']:.1e} |" for name in names),
            "",
            "Of the others from NumPy, in m, m/s, rad and rad/s:",
            "",
            *(f"- {name}: {other}: {value:.1e}" for (name, other), value in apart.items() if other in others),
            "",
        ]
    )


def memory(found: dict[str, Any]) -> str:
    """Peak memory of a large run, as a sentence."""
    gib = 1024**3
    return (
        f"{found['runs']} runs of {found['steps']} steps with {found['trackers']} trackers take "
        f"{found['peak_bytes'] / gib:.2f} GiB of memory; required: at most {found['required_bytes'] / gib:g}, "
        f"{met(found['met'])}.\n"
    )


def traffic_trackers(rows: list[dict[str, Any]]) -> str:
    """Trackers of several objects by both engines, beside Stone Soup's, as a section."""
    peers = {row["method"]: row for row in rows if row["engine"] == "Stone Soup"}
    by_numpy = {(row["method"], row["runs"]): row for row in rows if row["engine"] == "numpy"}

    def cells(row: dict[str, Any]) -> str:
        speed, required, numpy = row["times_real_time"], row["required"], by_numpy[row["method"], row["runs"]]
        limit = (f"at least {required:g}", met(speed >= required)) if required else ("", "")
        ratio = f"({digits(numpy['ms_per_scan'] / row['ms_per_scan'])} times)"
        peer = peers.get(row["method"])
        beside = (digits(peer["times_real_time"]), digits(speed / peer["times_real_time"])) if peer else ("", "")
        milliseconds = digits(row["ms_per_scan"]), f"{digits(numpy['ms_per_scan'])} {ratio}"
        return " | ".join([row["method"], str(row["runs"]), *milliseconds, digits(speed), *limit, *beside])

    fused = [row for row in rows if row["engine"] == "fused"]
    apart = max(row["largest_difference"] for row in fused)
    return "\n".join(
        [
            "## Tracking in traffic",
            "",
            "20 vehicles, a radar and a lidar of 20 Hz, 10 false alarms a scan, EKF with constant velocity; a batch "
            "tracks all of its runs at once. CPU time for a scan of one run by the fused engine and by NumPy, and the "
            "simulated time of all runs over the CPU time of the fused engine. Stone Soup follows 20 given tracks of "
            "one run, starts and ends none, and its JPDA is by belief propagation.",
            "",
            "Before anything is timed the estimates of tracks with the same associations are compared. Largest "
            "difference from trackbench, in m and m/s:",
            "",
            f"- all methods, one engine from the other, which have the same tracks: {apart:.1e}",
            *(f"- {method}: {row['engine']}: {row['largest_difference']:.1e}" for method, row in peers.items()),
            "",
            "| method | runs | ms per scan | by NumPy | times real time | required | | that of Stone Soup | "
            "times as fast |",
            "|---|---:|---:|---:|---:|---|---|---:|---:|",
            *(f"| {cells(row)} |" for row in fused),
            "",
            *goals([row["goal"] for row in fused if row["goal"]]),
            "",
        ]
    )


def traffic_scores(rows: list[dict[str, Any]]) -> str:
    """Scores of tracks beside those of Stone Soup and TrackEval, as a section."""

    def cells(row: dict[str, Any]) -> str:
        peer, ours = row["peer"], row["seconds"]
        beside = (peer, digits(1e3 * row["peer_seconds"]), digits(row["peer_seconds"] / ours)) if peer else ("",) * 3
        required = row["required_seconds"]
        limit = f"at most {1e3 * required:g} ms", met(ours <= required)
        return " | ".join([row["what"], digits(1e3 * ours), *limit, *beside])

    return "\n".join(
        [
            "## Scores of traffic",
            "",
            "CPU time of one run; that of Stone Soup for the whole sequence follows from its first steps.",
            "",
            "Before anything is timed the scores are compared. Largest difference from trackbench, relative for GOSPA "
            "and OSPA:",
            "",
            *(f"- {row['peer']}: {row['largest_difference']:.1e}" for row in rows if row["peer"]),
            "",
            "| score | ms | required | | beside | its ms | times as fast |",
            "|---|---:|---|---|---|---:|---:|",
            *(f"| {cells(row)} |" for row in rows),
            "",
        ]
    )


def isolation(rows: list[dict[str, Any]]) -> str:
    """What a process of its own costs a tracker, as a section."""
    first = rows[0]["first_start_ms"]
    return "\n".join(
        [
            "## A tracker in a process of its own",
            "",
            f"A tracker that is not built in, and does nothing. The first one takes {first:.0f} ms to start. Median of "
            "the time for a scan of the whole batch, asked in the bench's process and in one of its own.",
            "",
            "| members of the batch | to start, ms | a scan in the bench's process, µs | in its own, µs |",
            "|---:|---:|---:|---:|",
            *(
                f"| {row['batch']} | {row['start_ms']:.0f} | {digits(row['step_here_us'])} | {digits(row['step_us'])} |"
                for row in rows
            ),
            "",
        ]
    )


def languages(found: dict[str, Any]) -> str:
    """What a scan costs a program in C++, as a section."""
    if "without" in found:
        return f"## A tracker in another language\n\nNothing is measured: {found['without']}.\n"
    us = {(row["tracker"], row["members"]): row["us"] for row in found["rows"]}
    sizes = list(dict.fromkeys(members for _, members in us))
    names = dict.fromkeys(name for name, _ in us)

    def cells(name: str) -> str:
        first = us[name, sizes[0]]
        return " | ".join([name, *(digits(us[name, size]) for size in sizes), digits(first / found["bare_us"])])

    return "\n".join(
        [
            "## A tracker in another language",
            "",
            "The same extended Kalman filter as a program in C++ (that of `trackbench new tracker --language cpp`, "
            "compiled with `-O2`), and inside. Microseconds for a scan of all members, median of the elapsed time, "
            "with bench and program on one core. A bare exchange of 400 and 200 bytes by pipes takes "
            f"{digits(found['bare_us'])} there; the last column is the time for one member as a multiple of it. Before "
            "anything is timed all estimates are compared, to 1e-9 of the largest entry.",
            "",
            f"| | {' | '.join('one member' if size == 1 else f'{size} members' for size in sizes)} | bare exchanges |",
            f"|---|{'---:|' * len(sizes)}---:|",
            *(f"| {cells(name)} |" for name in names),
            "",
            *goals(found["goals"], "a program in another language"),
            "",
        ]
    )
