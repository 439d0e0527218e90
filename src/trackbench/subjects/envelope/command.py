"""The command ``trackbench envelope``, which maps where trackers meet their requirement."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console

from trackbench.api.scenario import load
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.base.exit_status import FAILED_PLUGIN
from trackbench.base.subjects import resolve
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import (
    WORKERS,
    engine_option,
    isolation_options,
    junit_option,
    names_in,
    out_option,
    write_suites,
)
from trackbench.cli.run_output import RunOutput
from trackbench.cli.terminal import if_interrupted, quiet_option, verbose_option
from trackbench.driving.isolation import Isolation
from trackbench.engine.choice import EngineName
from trackbench.results import require_file

DIFF = "trackbench.subjects.envelope.claim_commands:diff_command"


class EnvelopeGroup(click.Group):
    """Command group whose first argument is a scenario, or else the name of the subcommand ``diff``."""

    allow_extra_args = False
    allow_interspersed_args = True

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if args[:1] != ["diff"]:
            return super().make_context(info_name, args, parent, **extra)
        command: click.Command = resolve(DIFF)
        return command.make_context(f"{info_name} diff", args[1:], parent, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return ["diff"]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        command: click.Command | None = resolve(DIFF) if cmd_name == "diff" else None
        return command


@click.group(
    "envelope",
    cls=EnvelopeGroup,
    invoke_without_command=True,
    subcommand_metavar="| diff A B",
)
@click.argument("scenario", type=click.Path(path_type=Path), metavar="SCENARIO", required=True)
@click.option("--trackers", metavar="A,B", help="Only these of the scenario's trackers.")
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@out_option("Folder in which NAME-envelope is written.", "results")
@click.option("--workers", type=WORKERS, metavar="N", help="Processes; default: one per core if faster. Same claim.")
@click.option("--cluster", metavar="ADDRESS", help="Dask cluster: tcp://HOST:PORT or local:N.")
@engine_option
@isolation_options
@click.option(
    "--counter-examples", type=click.IntRange(0), metavar="N", help="Counter-examples for each tracker, at most."
)
@click.option("--no-recording", is_flag=True, help="Counter-examples without recording.rrd.")
@junit_option("Write the cells as JUnit XML.")
@click.option("--json", "as_json", is_flag=True, help="Print the claim as JSON, and nothing else.")
@quiet_option("Print only the headline.")
@verbose_option
def envelope_command(
    scenario: Path,
    trackers: str | None,
    settings: tuple[str, ...],
    out: Path,
    workers: int | None,
    cluster: str | None,
    engine: EngineName,
    isolation: Isolation,
    counter_examples: int | None,
    no_recording: bool,
    junit: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Map where trackers meet their requirement.

    The scenario's envelope: block says what is varied, its expect: block what is required. Each cell of the map
    holds, fails or is not shown to do either. An interrupted map goes on where it was.

    \b
    Examples:
      trackbench envelope envelope/sensor_quality
      trackbench envelope my.yaml --set envelope.cells=60 --workers 2

    \b
    Exit status: 0 the map is made, 2 bad input, 3 a tracker could not go on,
    4 cannot write
    """
    from trackbench.document.terminal import print_document
    from trackbench.subjects.envelope.api import EnvelopePlan, make_envelope
    from trackbench.subjects.envelope.claim import read_envelope
    from trackbench.subjects.envelope.claim_commands import suite_of_claim
    from trackbench.subjects.envelope.files import (
        claim_text,
        folder_of,
        looks_of,
        require_envelope_folder,
        save_envelope,
    )
    from trackbench.subjects.envelope.report import envelope_summary, headlines

    loaded = load(scenario, settings, trackers=None if trackers is None else names_in(trackers))
    name = loaded.config.name
    require_envelope_folder(name, out)
    if folder_of(name, out).resolve() in loaded.path.resolve().parents:
        raise InputError("is in the folder that would be replaced: give another --out", file=loaded.path)
    if junit is not None:
        require_file(junit, "--junit")
    store = looks_of(name, out)
    output = RunOutput(as_json, quiet)
    resumption = f"the runs so far are kept; the same command goes on from {store}"
    with executor(workers, cluster) as chosen, if_interrupted(resumption):
        plan = EnvelopePlan(isolation, engine, store, counter_examples)
        envelope = make_envelope(loaded, plan, chosen, output)
    folder = save_envelope(envelope, out, not no_recording)
    write_suites([suite_of_claim(envelope.claim)], junit)
    if as_json:
        print_answer(claim_text(envelope.claim), nl=False)
    elif quiet:
        for line in headlines(envelope.claim):
            print_answer(line)
    else:
        print_document(envelope_summary(read_envelope(folder)), Console(file=answer()))
        print_answer(f"\n{folder}/: envelope.html, envelope.md, claim.json, parts.parquet")
    raise click.exceptions.Exit(FAILED_PLUGIN if any(envelope.claim.failures.values()) else 0)
