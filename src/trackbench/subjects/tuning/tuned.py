"""Tuning trackers from a program."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from trackbench.api.plan import Counter
from trackbench.api.result import Report
from trackbench.api.run import Several
from trackbench.api.scenario import Named, listed, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.base.types import Progress, no_progress
from trackbench.engine.choice import EngineName
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.api import TunePlan, objective_of, tune_trackers
from trackbench.subjects.tuning.files import command_of_tuning, default_out, require_out, save_tuning, to_json
from trackbench.subjects.tuning.parameters import shown
from trackbench.subjects.tuning.report import tuning_document, tuning_summary
from trackbench.subjects.tuning.split import Split
from trackbench.subjects.tuning.tune import Tuning


class TunedTrackers:
    """What a tuning found. A notebook shows it as a page, ``print`` as text; ``found["ekf_cv"]`` is one tracker's."""

    def __init__(self, found: Sequence[Tuning], scenarios: Sequence[Scenario], command: str) -> None:
        self._found, self._scenarios, self._command = found, scenarios, command

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """By tracker, its best values by option, as ``load`` takes them after ``trackers.NAME.``."""
        return {item.tracker: dict(item.best.values) for item in self._found}

    def json(self) -> dict[str, Any]:
        """All numbers, as ``trackbench tune --json`` prints them."""
        return to_json(self._found, self._command)

    def report(self) -> Report:
        """The report, as ``trackbench tune`` writes it."""
        return Report(tuning_document(self._found, self._command))

    def save(self, out: Path | str) -> list[str]:
        """Write the scenario with the found values, the report and the numbers; returns the names of the files
        and of the folder of the figures.

        Args:
            out: a file whose name ends in ``.yaml``; for several scenarios a folder.

        Raises:
            TrackbenchError: a file cannot be written.
        """
        place = Path(out)
        require_out(place, self._scenarios)
        return [str(file) for file in save_tuning(self._found, self._scenarios, place, self._command)]

    def __getitem__(self, tracker: str) -> Tuning:
        return next(item for item in self._found if item.tracker == tracker)

    def __repr__(self) -> str:
        return f"<tuning of {', '.join(item.tracker for item in self._found)}>"

    def __str__(self) -> str:
        return str(Report(tuning_summary(self._found)))

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def tune(
    scenario: Scenario | Named | Several,
    trackers: Iterable[str],
    *,
    ranges: Mapping[str, Sequence[Any]] | Iterable[str] = (),
    objective: str | None = None,
    trials: int | None = None,
    storage: Path | str | None = None,
    train_scenes: int | None = None,
    test_scenes: int | None = None,
    train_runs: int | None = None,
    test_runs: int | None = None,
    train_seed: int | None = None,
    test_seed: int | None = None,
    seed: int = 0,
    workers: int = 1,
    engine: EngineName = "auto",
    progress: Progress = no_progress,
) -> TunedTrackers:
    """Find the options with which trackers do best, on some scenes and noise, and try them on others.

    Args:
        scenario: what :func:`load` gave or takes; a list or tuple of these gets one set of values for all.
        trackers: names of those that are tuned, each by itself.
        ranges: by option the least and the largest value as a tuple, or a list of choices; or texts such as
            ``"acceleration_sigma_mps2=0.1:30"``. The process noise, unless given.
        objective: ``likelihood``, ``position_rmse``, ``consistent_rmse``, ``gospa``, ``pareto`` or a metric of the
            scenario; unless given, ``gospa`` with hidden identities and a truth, else ``likelihood``.
        trials: how many sets of values are tried.
        storage: an SQLite file that keeps the trials, so that an interrupted search goes on.
        train_scenes: scenes that are tuned on.
        test_scenes: scenes that the values are tried on.
        train_runs: runs of each scene that is tuned on.
        test_runs: runs of each scene that is tried on.
        train_seed: of the noise that is tuned on.
        test_seed: of the noise that is tried on.
        seed: of the search.
        workers: number of processes.
        engine: what computes, as for :func:`run`.
        progress: called with the number of trials done and of all of a tracker.

    Raises:
        InputError: something is wrong in a scenario, a range or the storage, or Optuna is not installed.
        TrackbenchError: the processes that do the work died.
    """
    _require_numbers(2, trials=trials)
    _require_numbers(1, train_scenes=train_scenes, test_scenes=test_scenes, train_runs=train_runs, test_runs=test_runs)
    _require_numbers(0, train_seed=train_seed, test_seed=test_seed, seed=seed)
    loaded = [loaded_scenario(item) for item in (scenario if isinstance(scenario, list | tuple) else [scenario])]
    split = Split(train_scenes, test_scenes, train_runs, test_runs, train_seed, test_seed)
    kept = None if storage is None else Path(storage)
    plan = TunePlan(objective_of(objective, loaded), _texts(ranges), trials, seed, kept, split, engine=engine)
    names = listed(trackers)
    with executor(workers, None) as chosen:
        found = tune_trackers(loaded, names, plan, chosen, Counter(progress, "trials"))
    return TunedTrackers(found, loaded, command_of_tuning(loaded, names, plan, default_out(loaded)))


def _require_numbers(least: int, **given: Any) -> None:
    for name, value in given.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
            raise InputError(f"give a whole number, at least {least}, not {value!r}", key=name)


def _texts(ranges: Any) -> tuple[str, ...]:
    """Ranges as the command line writes them."""
    if isinstance(ranges, Mapping):
        return tuple(_text(key, value) for key, value in ranges.items())
    texts = tuple(listed(ranges)) if isinstance(ranges, Iterable) else (ranges,)
    if not all(isinstance(text, str) for text in texts):
        raise InputError(f"give a mapping from options to their ranges, or texts, not {ranges!r}", key="ranges")
    return texts


def _text(key: str, values: Any) -> str:
    is_range = isinstance(values, tuple) and len(values) == 2
    if not is_range and not isinstance(values, list):
        problem = f"give the least and the largest value as a tuple, or a list of choices, not {values!r}"
        raise InputError(problem, key=key)
    # Numbers of NumPy have tolist().
    plain = (value.tolist() if hasattr(value, "tolist") else value for value in values)
    return f"{key}={(':' if is_range else ',').join(map(shown, plain))}"
