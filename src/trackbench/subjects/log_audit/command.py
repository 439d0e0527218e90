"""The command ``trackbench audit``."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from trackbench import results
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import out_option
from trackbench.cli.terminal import progress

FOUND = 1


@click.command("audit")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG")
@out_option("Folder for the files.  [default: results/audit/NAME]")
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON, and nothing else.")
def audit_command(log: Path, out: Path | None, as_json: bool) -> None:
    """Find what is wrong with a log, and put it right.

    LOG is a scenario whose truth is recorded, with measurements. Of each sensor: bias, noise, time offset, mount,
    units, detections; and the clocks and the velocity of the truth. Writes a report, and where the findings
    explain the errors, scenario.yaml: LOG with the findings put in.

    \b
    Example:
      trackbench audit log.yaml

    \b
    Exit status:
      0 nothing found   1 something found   2 bad input   4 cannot write
    """
    from trackbench.document.terminal import print_document
    from trackbench.scenario import load_scenario
    from trackbench.subjects.log_audit.api import AUDIT, audit
    from trackbench.subjects.log_audit.report import log_audit_summary

    loaded = load_scenario(log)
    folder = out or Path("results", "audit", loaded.config.name)
    results.require_replaceable(folder, AUDIT)
    results.require_writable(folder.parent)
    with progress(f"auditing {loaded.config.name}", "sensors") as advance:
        reportable = audit(loaded, progress=advance)
    written = reportable.save(folder)
    if as_json:
        print_answer(results.json_text(reportable.json()), nl=False)
    else:
        print_document(log_audit_summary(reportable), Console(file=answer()))
        print_answer(f"\n{folder}/: {', '.join(written)}")
    raise click.exceptions.Exit(FOUND if reportable.findings or reportable.unexplained else 0)
