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
    ]
    return "\n".join(parts)


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _met(met: bool | None) -> str:
    return {True: "met", False: "missed", None: ""}[met]
