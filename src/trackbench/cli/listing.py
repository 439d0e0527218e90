"""``trackbench list``, ``trackbench check`` and ``trackbench schema``: commands that run nothing."""

from __future__ import annotations

import inspect
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import click

from trackbench.base.plugins import Registry
from trackbench.base.subjects import collected, offered, resolve
from trackbench.cli.answer import print_answer
from trackbench.cli.options import NearestChoice, isolation_options, scenarios_argument
from trackbench.cli.terminal import quiet_option
from trackbench.driving.isolation import Isolation
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.scenario.schema import json_schema
from trackbench.scenario.shipped import files_of_scenarios, shipped, shown_name
from trackbench.trackers.config import FilterConfig

Row = tuple[str, str]


def _scenarios() -> Iterator[Row]:
    return ((name, load_scenario(file).config.description) for name, file in shipped().items())


def _table(target: str) -> Iterable[Row]:
    return cast("Mapping[str, str]", resolve(target)).items()


def registered(source: str | Registry[Any], *without: str) -> Iterator[Row]:
    """Yield name and description of each plug-in in a registry, or in the registry that ``module:attribute`` names.

    A description is the first line of the docstring and the options except ``without``, or the reason of a failure.
    """
    registry: Registry[Any] = resolve(source) if isinstance(source, str) else source
    loaded, failed = registry.loaded(), registry.failures()
    for name in registry.names():
        if name in failed:
            yield name, f"failed: {failed[name]}"
        else:
            summary = (inspect.getdoc(loaded[name]) or "no description").splitlines()[0]
            yield name, f"{summary.rstrip('.')}{_options(loaded[name], without)}"


def _sensors() -> Iterator[Row]:
    from trackbench.models.sensors import Sensor
    from trackbench.models.sensors.presets import list_presets

    yield from registered("trackbench.models.sensors:SENSOR_MODELS", *Sensor.model_fields)
    for preset in list_presets():
        yield preset.name, f"{preset.kind} preset: {preset.title}. {preset.source}"


def _truth() -> Iterator[Row]:
    yield from registered("trackbench.truth:TRUTH_SOURCES", "source")
    for name, words in registered("trackbench.truth.tracks:TRAFFIC_FORMATS"):
        yield name, f"format of recorded-traffic: {words}"


def _options(plugin: Any, without: Sequence[str]) -> str:
    """Return the options that a plug-in declares, "; options a, b (m)", except the options in ``without``."""
    from trackbench.base.config.key_units import split_key

    fields = getattr(getattr(plugin, "Options", plugin), "model_fields", {})
    names = [field.alias or name for name, field in fields.items() if name not in without]
    shown = [f"{name} ({unit.words})" if (unit := split_key(name)[1]) is not None else name for name in names]
    return f"; options {', '.join(shown)}" if shown else ""


def _metrics() -> Iterator[Row]:
    from trackbench.metrics.registry import METRICS, metric_paths

    for name, reason in METRICS.failures().items():
        yield name, f"failed: {reason}"
    for metric in metric_paths([*collected("examples_of_metrics"), *METRICS.loaded().values()]):
        where = "hidden identities" if "tracks" in metric.needs else ""
        where += ", no truth" if "no truth" in metric.needs else ""
        notes = [metric.unit] * (metric.unit not in ("", "1")) + [f"{metric.better} is better"] * bool(metric.better)
        in_brackets = f" [{', '.join(notes)}]" if notes else ""
        yield metric.name, f"{where}{': ' if where else ''}{metric.meaning}{in_brackets}"


def _envs() -> Iterator[Row]:
    from trackbench.truth.highway import list_envs

    return ((name, "") for name in list_envs())


_CORE: dict[str, Callable[[], Iterable[Row]]] = {
    "scenarios": _scenarios,
    "trackers": partial(registered, "trackbench.trackers.published:TRACKERS", *FilterConfig.model_fields),
    "filters": partial(_table, "trackbench.trackers.builtin:FILTERS"),
    "motion-models": partial(registered, "trackbench.models.motion:MOTION_MODELS"),
    "sensors": _sensors,
    "sensor-effects": partial(registered, "trackbench.models.sensors.effects:EFFECTS", "type"),
    "truth": _truth,
    "metrics": _metrics,
    "worlds": partial(_table, "trackbench.scenario.worlds:MEANING"),
    "envs": _envs,
}
_OF_SUBJECTS = dict(offered("lists"))
LISTS = [*_CORE, *_OF_SUBJECTS]
_HELP = f"""Show what a scenario or an option can name.

WHAT is {", ".join(LISTS[:-1])} or {LISTS[-1]}. The options of a plug-in are shown with their units; one that cannot
be imported is shown with the reason. {" ".join(offer.summary for offer in _OF_SUBJECTS.values())}

\b
Example:
  trackbench list motion-models
"""


def rows(what: str) -> Iterable[Row]:
    """Return names and descriptions for ``trackbench list WHAT``, such as all sensors."""
    return (_CORE[what] if what in _CORE else resolve(_OF_SUBJECTS[what].target))()


@click.command("list", help=_HELP)
@click.argument("what", type=NearestChoice(LISTS), metavar="WHAT")
def list_command(what: str) -> None:
    """Show what a scenario or an option can name."""
    table = click.HelpFormatter(width=shutil.get_terminal_size().columns)
    table.write_dl(list(rows(what)))
    print_answer(table.getvalue(), nl=False)


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
    for file in files_of_scenarios(scenarios):
        loaded = load_scenario(file)
        notes = check(loaded, isolation)
        if quiet:
            continue
        sweeps = ", ".join(f"{name}: {len(points)} points" for name, points in loaded.sweeps.items())
        print_answer(f"{shown_name(file)}: ok{f' ({sweeps})' if sweeps else ''}")
        for note in notes:
            print_answer(f"  {note}")


@click.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of a scenario file, for editors.

    \b
    Example:
      trackbench schema > scenario.schema.json
    """
    print_answer(json.dumps(json_schema(), indent=2))
