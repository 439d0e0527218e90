"""The command ``trackbench score``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from trackbench import results
from trackbench.cli.answer import print_answer
from trackbench.cli.options import Finite, artifact_options, end_with_limits, junit_option, out_option, write_suites
from trackbench.cli.terminal import quiet_option


@click.command("score")
@click.argument("tracks", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="TRACKS...")
@click.option(
    "--truth",
    required=True,
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="BOXES",
    help="File of the true boxes, by the same clock; repeat it, or give a folder, for several sequences.",
)
@click.option("--map", "columns", multiple=True, metavar="KEY=COLUMN", help="Column of a key: x=pos_x, time=stamp:ns.")
@click.option("--format", "form", metavar="NAME", help="Format of the files, whatever their ending: kitti, ros.")
@click.option("--truth-format", metavar="NAME", help="Format of BOXES, if it differs; auto: by the ending.")
@click.option(
    "--rate", type=Finite(0, min_open=True), metavar="HZ", help="Frames per second, where frames are counted."
)
@click.option(
    "--time-offset", type=Finite(-3600, 3600), default=0.0, metavar="S", help="Time added to the tracks' times, s."
)
@click.option("--gate", "gates", multiple=True, metavar="METRIC:LIMIT", help="Limit: gospa:0.8, or relative gospa:2%.")
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@out_option("Folder in which the result's folder is made.", "results")
@artifact_options
@junit_option("Write the gates as JUnit XML.")
@click.option("--json", "as_json", is_flag=True, help="Print the result and its gates as JSON, and nothing else.")
@quiet_option("Print one line, and what failed.")
def score_command(
    tracks: tuple[Path, ...],
    truth: tuple[Path, ...],
    columns: tuple[str, ...],
    form: str | None,
    truth_format: str | None,
    rate: float | None,
    time_offset: float,
    gates: tuple[str, ...],
    settings: tuple[str, ...],
    out: Path,
    left_out: frozenset[str],
    junit: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Score tracks of a file against boxes of another.

    Several files of tracks are compared with each other. Columns are known by
    usual names, which are shown. The scenario is written beside the result's folder. A
    folder of boxes holds several sequences, and a folder of tracks one tracker's,
    in files of the same names; intervals rest on five sequences or more.

    \b
    Examples:
      trackbench score tracks.csv --truth boxes.csv --map x=pos_x
      trackbench score old/ new/ --truth boxes/
      trackbench score old.csv new.csv --truth boxes.csv --gate gospa:2%

    \b
    Exit status: 0 all gates kept, 1 a gate not kept, 2 bad input, 3 a tracker
    failed, 4 cannot write
    """
    from trackbench.api.plan import RunPlan
    from trackbench.api.run import run_scenarios
    from trackbench.base.errors import InputError
    from trackbench.base.execution import Executor
    from trackbench.base.files import write_whole
    from trackbench.cli.run import status
    from trackbench.cli.run_output import RunOutput
    from trackbench.report.junit import Suite, suite_of_run
    from trackbench.subjects.score.gate import Gate, judge_gates
    from trackbench.subjects.score.scenario import FileOptions, scoring_scenario

    limits = [Gate.parse(text) for text in gates]
    for text in columns:
        if "=" not in text:
            raise InputError(f"write KEY=COLUMN, such as x=pos_x, not {text!r}", key="--map")
    stated = [(key, column) for key, _, column in (text.partition("=") for text in columns)]
    if junit is not None:
        results.require_file(junit, "--junit")
    options = FileOptions(stated, form, rate, truth_format)
    loaded = scoring_scenario(tracks, truth, options, out, time_offset_s=time_offset, overrides=settings)
    for limit in limits:
        limit.require_files(len(loaded.config.trackers))
    output = RunOutput(as_json, quiet)
    (result,) = run_scenarios([loaded], RunPlan(out, left_out=left_out), Executor(), output)
    write_whole(loaded.path, loaded.text.encode())
    judgements = judge_gates(limits, result)
    cases = [item.case(result.name) for item in judgements]
    for case in [] if as_json else cases:
        print_answer(f"{case.outcome.upper()}  {case.name} ({case.message})")
    suite = suite_of_run(result)
    write_suites([Suite(suite.name, [*suite.cases, *cases])], junit)
    all_kept = all(item.passed for item in judgements)
    if as_json:
        summary = result.json()
        summary |= {"passed": summary["passed"] and all_kept, "gates": [item._asdict() for item in judgements]}
        print_answer(json.dumps(summary, indent=2, allow_nan=False))
    end_with_limits([case.outcome for case in cases], status([result]))
