"""The table and the figure, and the page that has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure, LegendEntry
from trackbench.report.pairs import difference_word

from ..markdown import table
from .fit import EFFECTS, FEWER_SEEDS, SEEDS, SPEEDS_MPS
from .recorded import DT, Window
from .reversal import RUNS, SCENES
from .statistics import NAMES, acceleration, autocorrelation

COLOURS = ("#1f1f1f", "#2a6fbb", "#d0702a")


def rounded(value: Any) -> Any:
    """All numbers to four digits, which do not depend on the machine."""
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, Mapping):
        return {key: rounded(item) for key, item in value.items()}
    return [rounded(item) for item in value] if isinstance(value, list | tuple) else value


def page(kept: Mapping[str, Any]) -> str:
    """All that is kept, in Markdown."""
    parts = [["# Drivers beside recorded ones", ""]]
    if "fit" in kept:
        parts.append([*_fit(kept["fit"])])
    if "reversal" in kept:
        parts.append([*_reversal(kept["reversal"])])
    return "\n".join(line for part in parts for line in part)


def _fit(fit: Mapping[str, Any]) -> Iterator[str]:
    drivers = fit["drivers"]
    yield "Made by `make drivers`; [the page](../../docs/drivers.md) says what it means. Accelerations are slopes of a"
    yield "polynomial of second order over 2.1 s, of recorded and of simulated speeds, without the first and the last"
    yield "second of a window."
    yield ""
    columns = fit["statistics"]
    yield from table(
        ["", *columns], [[name, *(_short(of[key]) for of in columns.values())] for key, name in NAMES.items()]
    )
    seeds = fit["rms_of_seeds"]
    yield f"RMS of the acceleration of `human` by single seeds of five leaders: {', '.join(map(_short, seeds))} m/s²."
    yield ""
    yield "![Distribution and autocorrelation of the acceleration](../../docs/images/drivers.svg)"
    yield ""
    yield "By the mean speed of a window, all of I-80 and `human`; the size of acceleration that would meet the RMS of"
    yield "I-80 in this range, with its 95 % interval over vehicles and seeds:"
    yield ""
    yield from by_speed(fit)
    yield f"Size that meets the RMS at all speeds together; `human` has {drivers['acceleration_rms_mps2']:g} m/s²:"
    yield ""
    yield from table(["", "size, m/s²"], [[name, _interval(of[0])] for name, of in fit["sizes"].items()])
    full = drivers["acceleration_full_mps"]
    yield f"By the speed from which on the acceleration has its full size (`human`: {full:g} m/s): the size that comes"
    yield "nearest to the RMS of the half that is fitted at all speeds above 4 m/s. The misfit is the RMS of the"
    yield "logarithms of simulated over recorded RMS by range of speed, weighted by the recorded instants."
    yield ""
    trials = [[_short(v) for v in trial] for trial in fit["full_size"]]
    yield from table(["full size from, m/s", "size, m/s²", "misfit"], trials)
    yield "By correlation time: the size that meets the RMS of the half that is fitted. The misfit is the RMS of the"
    yield "logarithms of simulated over recorded statistics."
    yield f"{SEEDS} seeds of each leader with the times of `human`, {FEWER_SEEDS} with others."
    yield ""
    for name, effect, tried in zip(("acceleration, m/s²", "lateral deviation, m"), EFFECTS, fit["trials"], strict=True):
        values = ", ".join(f"`{key}: {drivers[key]:g}`" for key in (effect.size, effect.time))
        yield f"{name}; `human` has {values}"
        yield ""
        yield from table(["correlation time, s", "size", "misfit"], [[_short(v) for v in trial] for trial in tried])


def by_speed(fit: Mapping[str, Any]) -> Iterator[str]:
    """The table of ranges of speed."""
    heads = [
        "mean speed, m/s",
        "vehicles of I-80",
        *(f"{what}: {who}" for what in ("RMS, m/s²", "below 0.1 m/s², %") for who in ("I-80", "human")),
        "size that meets the RMS",
    ]
    rows = [
        [
            f"{low} to {high}",
            str(road["windows"]),
            _short(road["rms"]),
            _short(human["rms"]),
            f"{100 * road['small']:.0f}",
            f"{100 * human['small']:.0f}",
            _interval(size),
        ]
        for low, high, road, human, size in zip(
            SPEEDS_MPS, SPEEDS_MPS[1:], *fit["by_speed"].values(), fit["sizes"]["I-80, all"][1:], strict=False
        )
    ]
    return table(heads, rows)


def _interval(size: Sequence[float]) -> str:
    return "{:.3f} ({:.3f} to {:.3f})".format(*size)


def _reversal(worlds: Mapping[str, Any]) -> Iterator[str]:
    yield "## Does the order of trackers hold?"
    yield ""
    yield (
        f"{SCENES} scenes of `highway`, {RUNS} runs each: RMSE of position, m, and velocity, m/s, and mean NEES (4 is "
        "right)."
    )
    yield ""
    trackers = [*next(iter(worlds.values()))["errors"]]
    rows = [
        [world, *(" / ".join(_short(v) for v in of["errors"][name].values()) for name in trackers)]
        for world, of in worlds.items()
    ]
    yield from table(["drivers", *trackers], rows)
    yield "Error of `ekf_cv` less that of the other, with its 95 % interval over scenes, and the verdict at the default"
    yield "margin."
    yield ""
    rows = [
        [
            world,
            pair["metric"],
            pair["b"],
            f"{pair['value']:+.4f} ({pair['ci95'][0]:+.4f} to {pair['ci95'][1]:+.4f})",
            difference_word(pair["verdict"]),
        ]
        for world, of in worlds.items()
        for pair in of["differences"]
    ]
    yield from table(["drivers", "metric", "other", "difference", "verdict"], rows)


def _short(value: float | None) -> str:
    return "n/a" if value is None or value != value else f"{value:.3g}"


def figure(columns: Mapping[str, Sequence[Window]]) -> Figure:
    """The distribution and the autocorrelation of the acceleration."""

    def paint(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2)
        for colour, windows in zip(COLOURS, columns.values(), strict=True):
            series = [acceleration(window) for window in windows]
            size = np.sort(np.abs(np.concatenate(series)))
            share = np.linspace(0, 100, 200)
            left.plot(np.percentile(size, share), share, color=colour)
            lags = range(0, 41, 2)
            right.plot([lag * DT for lag in lags], [autocorrelation(series, lag) for lag in lags], color=colour)
        left.set_xlim(0, 3)
        left.set_xlabel("|acceleration| below, m/s²")
        left.set_ylabel("share of the instants, %")
        right.set_xlabel("lag, s")
        right.set_ylabel("autocorrelation")

    return Figure(
        name="drivers",
        title="Acceleration of recorded and simulated drivers",
        caption="",
        alternative="Cumulative distribution and autocorrelation of the acceleration, recorded, human and steady",
        paint=paint,
        height=300,
        width=720,
        legend=tuple(LegendEntry(name, colour) for name, colour in zip(columns, COLOURS, strict=True)),
    )
