"""The results of one commit, computed with its own source and the interpreter that runs this, for `same_numbers`."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

REPOSITORY = Path(__file__).parents[1]
SCENARIOS = Path("src", "trackbench", "scenarios")
NOTES = "notes.json"
MOST_SCENES = 2
#: 0: all is well. 1: an expectation failed, or a fault was found. 3: a tracker failed, or nothing could be asked.
FINISHED = (0, 1, 3)
#: Written by a run, and made from the tables that are compared.
NOT_KEPT = (".html", ".md", ".rrd", ".svg", ".db")

_RUN = "run {scenarios}/scripted/figure_eight.yaml --runs 3 --no-recording"
_RUN_HIDDEN = "run {scenarios}/traffic/cut_in.yaml --runs 3 --no-recording"
_TUNE = (
    "tune {scenarios}/scripted/manoeuvres.yaml --trackers ekf_cv,imm --trials 4 --train-runs 2 --test-runs 2 --seed 3"
)
_TUNE_HIDDEN = (
    "tune {scenarios}/traffic/side_by_side.yaml --trackers gnn --trials 3 --train-runs 2 --test-runs 2 --seed 3"
    " --set truth.duration_s=5 --engine {engine} --json --out {out}/tuned.yaml"
)
_TUNE_ERROR = (
    "tune {scenarios}/scripted/figure_eight.yaml --trackers ukf --trials 3 --train-runs 2 --test-runs 2 --seed 3"
)
#: Every effect, of a radar; without spaces, and to be formatted.
_EFFECTS = ",".join(
    f'{{{{"type":"{name}",{options}}}}}'
    for name, options in {
        "reflection": '"toward_sensor":0.3,"along_m":0.4,"across_m":0.3',
        "faces": '"share":0.5',
        "signal_to_noise": '"half_range_m":120,"stated_at_m":60,"side_db":5',
        "correlated_errors": '"share":0.7,"time_s":0.5',
        "bias": '"sigmas":{{"azimuth_deg":0.2}}',
        "interference": '"per_minute":20,"duration_s":1,"alarms_per_scan":3',
        "ghosts": '"wall":[[-1000,6],[1000,6]],"probability":0.4',
        "quantised": '"steps":{{"range_m":0.2}}',
    }.items()
)
#: The commands beside `run` of a shipped scenario, by name: one after the other in one folder. What they print as JSON,
#: and every JSON file and table that they write, is compared. Those with ``{engine}`` are run with each engine.
COMMANDS: dict[str, list[str]] = {
    "compare": [
        f"{_RUN} --out {{out}}/a --engine numpy",
        f"{_RUN} --out {{out}}/b --engine numpy --seed 8",
        "compare {out}/a/figure_eight {out}/b/figure_eight --json",
        "compare {out}/a/figure_eight --metric velocity_rmse --metric nees.mean --json",
    ],
    "compare_hidden": [
        f"{_RUN_HIDDEN} --out {{out}}/a --engine numpy",
        f"{_RUN_HIDDEN} --out {{out}}/b --engine numpy --seed 8",
        "compare {out}/a/cut_in {out}/b/cut_in --json",
    ],
    "tune": [f"{_TUNE} --engine {{engine}} --json --out {{out}}/tuned.yaml"],
    "tune_error": [f"{_TUNE_ERROR} --objective position_rmse --engine {{engine}} --json --out {{out}}/tuned.yaml"],
    "tune_hidden": [_TUNE_HIDDEN],
    "doctor": ["doctor {scenarios}/highway.yaml#ukf_ctrv --json --out {out}/doctor"],
    "doctor_faulty": ["doctor {scenarios}/published/range_3km_a.yaml#ekf_confused --json --out {out}/doctor"],
    "doctor_hidden": ["doctor {scenarios}/traffic/cut_in.yaml#gnn --json --out {out}/doctor"],
    "doctor_naive": ["doctor {scenarios}/traffic/cut_in.yaml#naive --json --out {out}/doctor"],
    "audit": ["audit {scenarios}/recorded/udacity_fusion.yaml --json --out {out}/audit"],
    "effects": [
        f"{_RUN} --engine numpy --out {{out}}/known"
        f" --set sensors.radar.max_range_m=150 --set sensors.radar.effects=[{_EFFECTS}]",
        f"{_RUN_HIDDEN} --engine numpy --out {{out}}/hidden --set sensors.front_radar.effects=[{_EFFECTS}]",
        f"{_RUN_HIDDEN} --engine numpy --out {{out}}/typical --set sensors.roof_lidar.effects=typical",
    ],
    "run_workers": [f"{_RUN.replace('--runs 3', '--runs 40 --workers 2')} --out {{out}} --engine {{engine}}"],
}
NEEDS_DATA = {"audit"}


@dataclass(frozen=True, order=True)
class Task:
    """A scenario, or an entry of `COMMANDS`, by an engine."""

    name: str
    engine: str

    @property
    def folder(self) -> str:
        return f"{self.engine}/{self.name}"


@dataclass(frozen=True)
class Checkout:
    """A commit's files, and a folder of its own for what they need to run."""

    source: Path
    work: Path

    def prepare(self) -> None:
        """Give it package metadata and an empty cache, and see that its own source is what is imported.

        Raises:
            SystemExit: it cannot be imported, or another source is.
        """
        project = tomllib.loads((self.source / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        info = self.work / "metadata" / f"{project['name']}-{project['version']}.dist-info"
        info.mkdir(parents=True)
        lines = [f"Name: {project['name']}", f"Version: {project['version']}"]
        lines += [f"Requires-Dist: {requirement}" for requirement in project["dependencies"]]
        (info / "METADATA").write_text("\n".join(["Metadata-Version: 2.1", *lines, ""]), encoding="utf-8")
        groups = {"console_scripts": project.get("scripts", {}), **project.get("entry-points", {})}
        points = [f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in names.items()) for group, names in groups.items()]
        (info / "entry_points.txt").write_text("\n\n".join(points) + "\n", encoding="utf-8")
        (self.work / "cwd").mkdir()
        command = [sys.executable, "-c", "import trackbench; print(trackbench.__file__)"]
        run = subprocess.run(command, env=self._environment(), cwd=self.work / "cwd", capture_output=True, text=True)
        if run.returncode or not Path(run.stdout.strip()).resolve().is_relative_to(self.source.resolve()):
            sys.exit(f"the source of {self.source} is not what is imported: {run.stdout}{run.stderr}")

    def _environment(self) -> dict[str, str]:
        # The metadata comes before the source, in which another installation may have left its own.
        path = os.pathsep.join(str(folder.resolve()) for folder in (self.work / "metadata", self.source / "src"))
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        # A truth that another commit has stored would hide that this one makes another.
        cache = str((self.work / "cache").resolve())
        return {**os.environ, **threads, "PYTHONPATH": path, "TRACKBENCH_CACHE": cache, "NO_COLOR": "1"}

    def compute(self, task: Task, runs: int, out: Path) -> str:
        """Run a task into an empty folder, and keep what is compared; why it failed, or nothing."""
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        file = self.source / SCENARIOS / f"{task.name}.yaml"
        commands = COMMANDS[_command(task)] if _command(task) else [_run(file, runs)] if file.is_file() else []
        if not commands:
            return f"there is no {file.name} in {file.parent}"
        replaced = {"out": out.resolve(), "engine": task.engine, "scenarios": (self.source / SCENARIOS).resolve()}
        for number, command in enumerate(commands):
            arguments = [argument.format(**replaced) for argument in command.split()]
            expanded = [str(path) for argument in arguments for path in _files(argument)]
            run = subprocess.run(
                [sys.executable, "-m", "trackbench", *expanded],
                env=self._environment(),
                cwd=self.work / "cwd",
                capture_output=True,
                text=True,
            )
            if run.returncode not in FINISHED:
                lines = (run.stderr or run.stdout).strip().splitlines()
                return f"status {run.returncode} of {' '.join(arguments)}: {' / '.join(lines[-3:])}"
            if "--json" in arguments:
                (out / f"printed_{number}.json").write_text(run.stdout, encoding="utf-8")
        for path in [path for path in out.rglob("*") if path.is_file()]:
            if path.suffix in NOT_KEPT:
                path.unlink()
            elif path.suffix == ".json":
                text = path.read_text(encoding="utf-8").replace(str(replaced["out"]), "OUT")
                path.write_text(text.replace(str(replaced["scenarios"]), "SCENARIOS"), encoding="utf-8")
        return ""


def _command(task: Task) -> str:
    folder, _, name = task.name.partition("/")
    return name if folder == "commands" else ""


def _files(argument: str) -> list[Any]:
    """The files of a pattern, and of anything else itself."""
    folder, star, rest = argument.partition("*")
    return sorted(Path(folder).glob(star + rest)) if star else [argument]


def _run(file: Path, runs: int) -> str:
    """The arguments of the run of a scenario: no more runs than it has, and of its scenes the first two at most."""
    scenario: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    seeds = scenario["truth"].get("seeds", 1)
    scenes = f" --scenes {MOST_SCENES}" if (len(seeds) if isinstance(seeds, list) else seeds) > MOST_SCENES else ""
    least = min(runs, scenario.get("monte_carlo", {}).get("runs", runs))
    return f"run {file.resolve()} --runs {least}{scenes} --no-recording --engine {{engine}} --out {{out}}"


def tasks(source: Path, engines: list[str]) -> list[Task]:
    """All that is run: what needs recorded data only where TRACKBENCH_DATA names them."""
    data = bool(os.environ.get("TRACKBENCH_DATA"))
    files = sorted((source / SCENARIOS).rglob("*.yaml"))
    kept = [file for file in files if data or "TRACKBENCH_DATA" not in file.read_text(encoding="utf-8")]
    names = [str(file.relative_to(source / SCENARIOS).with_suffix("")) for file in kept]
    of_scenarios = [Task(name, engine) for name in names for engine in engines]
    of_commands = [
        Task(f"commands/{name}", engine)
        for name, commands in COMMANDS.items()
        if data or name not in NEEDS_DATA
        for engine in (engines if any("{engine}" in command for command in commands) else ["numpy"])
    ]
    return of_scenarios + of_commands


def checked_out(place: str, folder: Path) -> Path:
    """A directory itself; the files of a commit in ``folder``, which `removed` takes away.

    Raises:
        SystemExit: neither a checkout nor a commit.
    """
    if Path(place).is_dir():
        return Path(place).resolve()
    command = ["git", "-C", str(REPOSITORY), "worktree", "add", "--detach", str(folder), place]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{place} is neither a directory nor a commit: {run.stderr.strip()}")
    return folder


def removed(folder: Path) -> None:
    """Take away what `checked_out` made."""
    if folder.exists():
        subprocess.run(["git", "-C", str(REPOSITORY), "worktree", "remove", "--force", str(folder)], check=True)


def write_notes(folder: Path, notes: dict[str, Any]) -> None:
    """Keep beside saved results how they were made, and which failed."""
    (folder / NOTES).write_text(json.dumps(notes, indent=2) + "\n", encoding="utf-8")


def read_notes(folder: Path) -> dict[str, Any]:
    """What `write_notes` wrote.

    Raises:
        SystemExit: there is none.
    """
    try:
        notes: dict[str, Any] = json.loads((folder / NOTES).read_text(encoding="utf-8"))
    except OSError:
        sys.exit(f"{folder} holds no results that --save has kept")
    return notes
