"""``trackbench list``"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable

import click

from trackbench.errors import InputError

Row = tuple[str, str]


def _scenarios() -> Iterable[Row]:
    from trackbench.scenario import load_scenario
    from trackbench.scenario.shipped import at_hand

    for name, file in at_hand().items():
        try:
            yield name, load_scenario(file).config.description
        except InputError as error:
            yield name, f"cannot be read: {error}"


def _trackers() -> Iterable[Row]:
    from trackbench.plugins import published

    for name, entry in sorted(published().items()):
        try:
            summary = (entry.load().__doc__ or "").strip().splitlines()
            yield name, summary[0] if summary else entry.value
        except Exception as error:
            yield name, f"cannot be imported: {type(error).__name__}: {error}"


def _filters() -> Iterable[Row]:
    from trackbench.trackers.builtin import FILTERS

    return FILTERS.items()


def _motion_models() -> Iterable[Row]:
    from trackbench.models.motion import MOTION_MODELS
    from trackbench.trackers.config import MOTION_NOISE

    for name, model in MOTION_MODELS.items():
        yield name, f"state {', '.join(model.components)}; noise {', '.join(MOTION_NOISE[name])}"


def _sensors() -> Iterable[Row]:
    from trackbench.sensing.presets import list_presets

    yield "radar", "range, azimuth, range rate"
    yield "speed_radar", "range, azimuth, speed of the target over ground in place of the range rate"
    yield "lidar", "position in the sensor's frame"
    for preset in list_presets():
        yield preset.name, f"{preset.kind} preset: {preset.title}. {preset.source}"


def _metrics() -> Iterable[Row]:
    from trackbench.errors import InputError
    from trackbench.metrics.plugin import find, published
    from trackbench.metrics.registry import known

    own = []
    for name in published():
        try:
            own.append(find(name))
        except InputError as error:
            yield name, f"cannot be used: {error.message}"
    for metric in known(own):
        unit = f" [{metric.unit}]" if metric.unit not in ("", "1") else ""
        yield metric.path, metric.meaning + unit


def _envs() -> Iterable[Row]:
    from trackbench.truth import list_envs

    return ((name, "") for name in list_envs())


LISTS: dict[str, Callable[[], Iterable[Row]]] = {
    "scenarios": _scenarios,
    "trackers": _trackers,
    "filters": _filters,
    "motion-models": _motion_models,
    "sensors": _sensors,
    "metrics": _metrics,
    "envs": _envs,
}


@click.command("list")
@click.argument("what", type=click.Choice(list(LISTS)), metavar="WHAT")
def list_command(what: str) -> None:
    """Show what a scenario can name.

    WHAT is scenarios, trackers, filters, motion-models, sensors, metrics or envs.

    \b
    Example:
      trackbench list motion-models
    """
    table = click.HelpFormatter(width=shutil.get_terminal_size().columns)
    table.write_dl(LISTS[what]())
    click.echo(table.getvalue(), nl=False)
