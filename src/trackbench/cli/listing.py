"""``trackbench list``, ``trackbench check`` and ``trackbench schema``: commands that run nothing."""

from __future__ import annotations

import inspect
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trackbench.base.errors import InputError
from trackbench.base.plugins import Registry
from trackbench.base.subjects import offered, resolve
from trackbench.cli.options import NearestChoice, isolation_options, scenarios_argument
from trackbench.cli.terminal import quiet_option
from trackbench.driving.isolation import Isolation
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.scenario.schema import json_schema
from trackbench.scenario.shipped import scenario_files, shown_name

if TYPE_CHECKING:
    from trackbench.metrics import Field


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
    from trackbench.trackers.config import FilterConfig
    from trackbench.trackers.published import TRACKERS, options_of

    def told(factory: Any) -> str:
        options = options_of(factory)
        if options is not None and issubclass(options, FilterConfig):
            return "; options as beside filter:"
        return _options(options) if options is not None else ""

    return _plugins(TRACKERS, told)


def _filters() -> Iterable[Row]:
    from trackbench.trackers.builtin import FILTERS

    return FILTERS.items()


def _motion_models() -> Iterable[Row]:
    from trackbench.models.motion import MOTION_MODELS

    return _plugins(MOTION_MODELS, _options)


def _sensors() -> Iterable[Row]:
    from trackbench.models.sensors import SENSOR_MODELS, Sensor
    from trackbench.models.sensors.presets import list_presets

    yield from _plugins(SENSOR_MODELS, lambda found: _options(found, beyond=Sensor))
    for preset in list_presets():
        yield preset.name, f"{preset.kind} preset: {preset.title}. {preset.source}"


def _truth_sources() -> Iterable[Row]:
    from trackbench.truth import TRUTH_SOURCES

    return _plugins(TRUTH_SOURCES, lambda found: _options(found, without=("source",)))


def _plugins(registry: Registry[Any], told: Callable[[Any], str]) -> Iterator[Row]:
    """The first line of each one's docstring and its options; of one that fails, the reason."""
    loaded, failed = registry.loaded(), registry.failures()
    for name in registry.names():
        if name in failed:
            yield name, f"failed: {failed[name]}"
        else:
            summary = (inspect.getdoc(loaded[name]) or "no description").splitlines()[0]
            yield name, f"{summary.rstrip('.')}{told(loaded[name])}"


def _options(found: Any, beyond: Any = None, without: Sequence[str] = ()) -> str:
    """The options of a class with their units, those of a base class left out."""
    from trackbench.base.config.key_units import split_key

    names = [
        field.alias or name
        for name, field in found.model_fields.items()
        if name not in without and (beyond is None or name not in beyond.model_fields)
    ]
    units = {name: unit.words for name in names if (unit := split_key(name)[1]) is not None}
    shown = [f"{name} ({units[name]})" if name in units else name for name in names]
    return f"; options {', '.join(shown)}" if shown else ""


def _metrics() -> Iterable[Row]:
    from trackbench.metrics.registry import METRICS, metric_paths
    from trackbench.scenario.cross_checks import traffic_paths

    for name, reason in METRICS.failures().items():
        yield name, f"failed: {reason}"
    own = METRICS.loaded().values()
    yield from _told(metric_paths(metric for metric in own if metric.scores == "estimates"))
    of_tracks = [metric for metric in own if metric.scores == "tracks"]
    yield from _told(traffic_paths(truth=True, own=of_tracks).values(), "hidden identities: ")
    yield from _told(traffic_paths(truth=False).values(), "hidden identities, no truth: ")


def _told(metrics: Iterable[Field], where: str = "") -> Iterator[Row]:
    for metric in metrics:
        unit = f" [{metric.unit}]" if metric.unit not in ("", "1") else ""
        yield metric.name, where + metric.meaning + unit


def _envs() -> Iterable[Row]:
    from trackbench.truth import list_envs

    return ((name, "") for name in list_envs())


_CORE: dict[str, Callable[[], Iterable[Row]]] = {
    "scenarios": _scenarios,
    "trackers": _trackers,
    "filters": _filters,
    "motion-models": _motion_models,
    "sensors": _sensors,
    "truth-sources": _truth_sources,
    "metrics": _metrics,
    "envs": _envs,
}


#: Of the core by function, of the subjects by its ``module:attribute``.
LISTS: dict[str, Callable[[], Iterable[Row]] | str] = {**_CORE, **dict(offered("lists"))}


@click.command("list")
@click.argument("what", type=NearestChoice(list(LISTS)), metavar="WHAT")
def list_command(what: str) -> None:
    """Show what a scenario or an option can name.

    WHAT is scenarios, trackers, filters, motion-models, sensors, truth-sources, metrics, envs or checks. The options
    of a plug-in are shown with their units; one that cannot be imported is shown with the reason. The checks are
    those of `trackbench doctor`.

    \b
    Example:
      trackbench list motion-models
    """
    table = click.HelpFormatter(width=shutil.get_terminal_size().columns)
    source = LISTS[what]
    table.write_dl((resolve(source) if isinstance(source, str) else source)())
    click.echo(table.getvalue(), nl=False)


@click.command("check")
@scenarios_argument
@isolation_options
@quiet_option("Only say what is wrong.")
def check_command(scenarios: tuple[Path, ...], isolation: Isolation, quiet: bool) -> None:
    """Validate scenario files without running them.

    \b
    Example:
      trackbench check my_scenario.yaml
    """
    for file in scenario_files(scenarios):
        loaded = load_scenario(file)
        check(loaded, isolation)
        if quiet:
            continue
        sweeps = ", ".join(f"{name}: {len(points)} points" for name, points in loaded.sweeps.items())
        click.echo(f"{shown_name(file)}: ok{f' ({sweeps})' if sweeps else ''}")


@click.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of a scenario file, for editors.

    \b
    Example:
      trackbench schema > scenario.schema.json
    """
    click.echo(json.dumps(json_schema(), indent=2))
