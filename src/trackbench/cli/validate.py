"""``trackbench check`` and ``trackbench schema``"""

from __future__ import annotations

import json
from pathlib import Path

import click

from trackbench.cli.options import isolation_options, scenarios_argument
from trackbench.cli.terminal import quiet_option
from trackbench.driving.isolation import Isolation
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.scenario.schema import json_schema
from trackbench.scenario.shipped import scenario_files, shown_name


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
