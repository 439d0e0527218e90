"""The benchmark's figures as Markdown."""

from __future__ import annotations

from typing import Any


def markdown(found: dict[str, Any]) -> str:
    """The tables that are written beside ``benchmark.json``."""
    problem, machine = found["problem"], found["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    parts = [
        "# Benchmark",
        "",
        f"Made by `make benchmark`. {machine['cpu']}, one thread, Python {machine['python']}, {versions}.",
        "",
        f"The same measurements for all: {problem['steps']} measurements of one weaving target, radar and lidar in "
        f"turn, in {problem['runs']} Monte-Carlo runs; FilterPy and Stone Soup take the first {problem['peer_runs']} "
        "of them. A step is the prediction to a measurement and the update with it, for one run. Best of "
        f"{problem['repetitions']} repetitions in which the engines take turns.",
        "",
        "| problem | engine | µs per step of one run |",
        "|---|---|---:|",
        *(
            f"| {row['problem']} | {row['engine']} | {_digits(row['value'])} |"
            for row in sorted(found["microseconds_per_step"], key=lambda row: (row["problem"], row["value"]))
        ),
        "",
        "The UKF of the peers adds the process noise to the predicted covariance; the augmented one, which spreads "
        "sigma points over it, is trackbench's default and has no counterpart there.",
        "",
        "| | measured | required | |",
        "|---|---:|---|---|",
        *(
            f"| {row['what']} | {_digits(row['value'])} | {row['required']} | {_met(row['met'])} |"
            for row in found["ratios"]
        ),
    ]
    memory = found["memory"]
    if memory is not None:
        gib = 1024**3
        size = f"{memory['runs']} runs of {memory['steps']} steps with {memory['trackers']} trackers"
        parts.append(
            f"| peak memory of {size}, GiB | "
            f"{memory['peak_bytes'] / gib:.2f} | at most {memory['required_bytes'] / gib:g} | {_met(memory['met'])} |"
        )
    parts += [
        "",
        "Before anything is timed the estimates are compared, every component at every step. Largest difference from "
        "trackbench, in m, m/s, rad and rad/s:",
        "",
        *(f"- {name}: {value:.1e}" for name, value in found["largest_difference"].items()),
        "",
        traffic_trackers(found["traffic_trackers"]),
        traffic_scores(found["traffic_scores"]),
        isolation(found["isolation"]),
        *([stages(found["stages_before"], found["stages"])] if found["stages"] else []),
    ]
    return "\n".join(parts)


def traffic_trackers(rows: list[dict[str, Any]]) -> str:
    """Trackers of several objects beside Stone Soup's, as a section."""
    peers = {row["method"]: row for row in rows if row["engine"] != "trackbench"}

    def cells(row: dict[str, Any]) -> str:
        speed, required = row["times_real_time"], row["required"]
        limit = (f"at least {required:g}", _met(speed >= required)) if required else ("", "")
        peer = peers.get(row["method"])
        beside = (_digits(peer["times_real_time"]), _digits(speed / peer["times_real_time"])) if peer else ("", "")
        return " | ".join(
            [row["method"], str(row["runs"]), _digits(row["ms_per_scan"]), _digits(speed), *limit, *beside]
        )

    return "\n".join(
        [
            "## Tracking in traffic",
            "",
            "20 vehicles, a radar and a lidar of 20 Hz, 10 false alarms a scan, EKF with constant velocity; a batch "
            "tracks all of its runs at once. CPU time for a scan of one run, and the simulated time of all runs over "
            "the CPU time. Stone Soup follows 20 given tracks of one run, starts and ends none, and its JPDA is by "
            "belief propagation.",
            "",
            "Before anything is timed the estimates of tracks with the same associations are compared. Largest "
            "difference from trackbench, in m and m/s:",
            "",
            *(f"- {method}: {row['engine']}: {row['largest_difference']:.1e}" for method, row in peers.items()),
            "",
            "| method | runs | ms per scan | times real time | required | | that of Stone Soup | times as fast |",
            "|---|---:|---:|---:|---|---|---:|---:|",
            *(f"| {cells(row)} |" for row in rows if row["engine"] == "trackbench"),
            "",
        ]
    )


def traffic_scores(rows: list[dict[str, Any]]) -> str:
    """Scores of tracks beside those of Stone Soup and TrackEval, as a section."""

    def cells(row: dict[str, Any]) -> str:
        peer, ours = row["peer"], row["seconds"]
        beside = (peer, _digits(1e3 * row["peer_seconds"]), _digits(row["peer_seconds"] / ours)) if peer else ("",) * 3
        required = row["required_seconds"]
        limit = f"at most {1e3 * required:g} ms", _met(ours <= required)
        return " | ".join([row["what"], _digits(1e3 * ours), *limit, *beside])

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
                f"| {row['batch']} | {row['start_ms']:.0f} | "
                f"{_digits(row['step_here_us'])} | {_digits(row['step_us'])} |"
                for row in rows
            ),
            "",
        ]
    )


def stages(before: dict[str, Any], after: list[dict[str, Any]]) -> str:
    """Seconds of each stage of each command, before and after, as a section."""
    old = {item["command"]: item for item in before["commands"]}
    names = list(dict.fromkeys(stage for item in (*before["commands"], *after) for stage in item["stages"]))
    # What a second of then is worth now.
    scale = {item["command"]: item["fixed_work"] / old[item["command"]]["fixed_work"] for item in after}

    def row(name: str, *cells: str) -> str:
        return f"| {name} | {' | '.join(cells)} |"

    def both(item: dict[str, Any], kind: int, chosen: list[str]) -> str:
        then, now = (
            sum(found["stages"].get(stage, (0.0, 0.0))[kind] for stage in chosen)
            for found in (old[item["command"]], item)
        )
        return f"{then * scale[item['command']]:.2f} → {now:.2f}"

    return "\n".join(
        [
            "## Where the time goes",
            "",
            f"Processor seconds of each stage at commit {before['commit']} → now, in one process and one thread. A "
            "fixed piece of work, timed beside each command then and now, turns the seconds of then into those of now. "
            "The truth is cached, but for the first command. A sweep has one vehicle, 200 measurements and 20 runs.",
            "",
            row("stage", *(f"`{item['command']}`" if "run" in item["command"] else item["command"] for item in after)),
            row("---", *("---:" for _ in after)),
            *(row(name, *(both(item, 0, [name]) for item in after)) for name in names),
            row("all", *(both(item, 0, names) for item in after)),
            row("elapsed", *(both(item, 1, names) for item in after)),
            "",
        ]
    )


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _met(met: bool | None) -> str:
    return {True: "met", False: "missed", None: ""}[met]
