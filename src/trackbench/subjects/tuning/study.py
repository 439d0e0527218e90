"""The trials of a search in an Optuna study: in memory, or in a file that only the same search continues."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trackbench.base.databases import open_tables
from trackbench.base.errors import InputError
from trackbench.subjects.tuning.entry import Values, module_file, plain
from trackbench.subjects.tuning.evaluation import Bench, Outcome
from trackbench.subjects.tuning.measures import WORDS, Sums
from trackbench.subjects.tuning.objectives import Objective
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.trackers.config import PluginConfig

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution


@dataclass(frozen=True)
class TuningTrial:
    """Values that were tried, and what came of them."""

    values: Mapping[str, Any]
    parts: Mapping[str, float] = field(default_factory=dict)
    """Quantities of the objective; empty where it failed."""
    losses: tuple[float, ...] = ()
    failed: str = ""
    measures: Mapping[str, float] = field(default_factory=dict)
    """Geometric mean over the scenarios of what start and tuned are compared by."""

    @property
    def loss(self) -> float:
        """The first loss; infinite where it failed."""
        return self.losses[0] if self.losses else math.inf


def trial_of(objective: Objective, values: Values, outcomes: Sequence[Outcome], start: Sequence[Sums]) -> TuningTrial:
    """What came of a trial, from its outcome in each scenario and the start's."""
    parts = objective(outcomes, start)
    if isinstance(parts, str):
        return TuningTrial(dict(values), failed=parts)
    sums = [outcome.sums for outcome in outcomes if outcome.sums is not None]
    return TuningTrial(dict(values), parts, objective.losses(parts), measures=measures_of(sums))


def measures_of(sums: Sequence[Sums]) -> dict[str, float]:
    """What start and tuned are compared by, over the scenarios: the geometric mean, of the likelihood the mean."""
    measures = {}
    for name in sums[0].measures if sums else ():
        values = np.array([item.value(name) for item in sums])
        if np.isfinite(values).all() and (name == "log_likelihood" or (values > 0).all()):
            measures[name] = float(values.mean() if name == "log_likelihood" else np.exp(np.log(values).mean()))
    return measures


def best_trial(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """The trial with the smallest loss, the first of several; None where all failed."""
    done = [trial for trial in trials if trial.losses]
    return min(done, key=lambda trial: trial.loss) if done else None


def chosen_of(objective: Objective, trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """The trial whose values are written, one of the front where there are two losses; None where all failed."""
    done = [trial for trial in trials if trial.losses]
    among = front_of(done) if len(objective.axes) > 1 else done
    return min(among, key=lambda trial: objective.rank(trial.parts)) if among else None


def front_of(trials: Sequence[TuningTrial]) -> list[TuningTrial]:
    """The trials that no other one beats in both losses, by the first one."""
    done = sorted((trial for trial in trials if trial.losses), key=lambda trial: trial.losses)
    front: list[TuningTrial] = []
    for trial in done:
        if not front or trial.losses[1] < front[-1].losses[1]:
            front.append(trial)
    return front


#: Results that differ by less, relative to themselves, are those of another processor.
ROUNDING = 1e-9
#: Most differences that are told.
MOST = 3
#: The part of a signature that follows from all others, unless a file or a program changed.
START = "start"


def study_signature(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> dict[str, Any]:
    """What determines the trials of a tracker, as JSON.

    Args:
        tracker: its name.
        objective: name of what it is tuned for.
        parameters: what is tuned.
        seed: of the search.
        train: the scenarios.
        start: what the tracker gives as it is in each. It tells of a changed log, plug-in or program.
    """
    return {
        "objective": objective,
        "seed": seed,
        "ranges": {item.key: item.as_json() for item in parameters},
        "scenarios": {bench.name: _settings(bench, tracker) for bench in train},
        START: {
            bench.name: {name: value for name in sums.measures if math.isfinite(value := sums.value(name))}
            for bench, sums in zip(train, start, strict=True)
        },
    }


def setting_differences(kept: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In what two signatures differ, in words; empty where they do not."""
    before, after = (
        dict(_leaves({key: value for key, value in each.items() if key != START}, "")) for each in (kept, now)
    )
    pairs = {key: (before.get(key, "not given"), after.get(key, "not given")) for key in {**after, **before}}
    changes = [f"{key} was {old} and is {new}" for key, (old, new) in pairs.items() if not _same(old, new)]
    if changes:
        more = f" and {len(changes) - MOST} more" if len(changes) > MOST else ""
        return "; ".join(changes[:MOST]) + more
    for name, measures in now[START].items():
        for measure, value in measures.items():
            earlier = kept.get(START, {}).get(name, {}).get(measure, math.nan)
            if not _same(earlier, value):
                return (
                    f"in {name} the start now gives {WORDS[measure]} {value:.6g}, and gave {earlier:.6g}: its code, "
                    "the measurements or trackbench changed"
                )
    return ""


def _settings(bench: Bench, tracker: str) -> dict[str, Any]:
    """Of a scenario what one tracker's trials depend on."""
    config, document = bench.scenario.config, bench.scenario.document.value
    entry = config.trackers[tracker]
    use = entry.reference if isinstance(entry, PluginConfig) else ""
    source = module_file(use, bench.scenario.folder)
    return {
        **{key: value for key, value in document.items() if key not in ("trackers", "expect")},
        "truth": config.truth.model_dump(mode="json", fallback=str),
        "monte_carlo": config.monte_carlo.model_dump(mode="json"),
        "tracker": plain(bench.scenario, tracker),
        "module": hashlib.sha256(source.read_bytes()).hexdigest()[:12] if source is not None else "",
    }


def _leaves(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """The values that are neither mapping nor list, each with its dotted key."""
    if isinstance(node, Mapping):
        parts = [*node.items()]
    elif isinstance(node, list | tuple):
        parts = [*enumerate(node)]
    else:
        yield path, node
        return
    for key, value in parts:
        yield from _leaves(value, f"{path}.{key}" if path else str(key))


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=ROUNDING)
    return bool(first == second)


SIGNATURE = "trackbench"
Direction = Literal["minimize", "maximize"]


def require_optuna() -> None:
    """Make sure that Optuna is installed.

    Raises:
        InputError: it is not; with the name of what installs it.
    """
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise InputError("tuning needs Optuna: pip install 'trackbench[tune]'") from None


class Study:
    """The trials of one tracker.

    Args:
        name: of the study.
        storage: an SQLite file; in memory unless given.
        parameters: what is tuned.
        axes: what each loss is.
        signature: what determines the trials; a stored study of another one is refused.
    """

    def __init__(
        self,
        name: str,
        storage: Path | None,
        parameters: Sequence[Parameter],
        axes: Sequence[str],
        signature: Mapping[str, Any],
    ) -> None:
        import optuna
        from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._parameters = parameters
        self._distributions: dict[str, BaseDistribution] = {}
        for item in parameters:
            if item.scale == "choice":
                self._distributions[item.key] = CategoricalDistribution([json.dumps(choice) for choice in item.choices])
            elif item.scale == "integer":
                self._distributions[item.key] = IntDistribution(int(item.low), int(item.high))
            else:
                self._distributions[item.key] = FloatDistribution(item.low, item.high, log=item.scale == "log")
        self._directions: list[Direction] = ["minimize"] * len(axes)
        self._study = _open(name, storage, self._directions)
        kept = self._study.user_attrs.get(SIGNATURE)
        if kept is None:
            if self._study.get_trials(deepcopy=False):
                raise InputError(f"its study {name!r} is of another program", key="--storage", file=storage)
            self._study.set_user_attr(SIGNATURE, dict(signature))
        elif changes := setting_differences(kept, json.loads(json.dumps(signature))):
            problem = f"its study {name!r} is of another search: {changes}; give another file"
            raise InputError(problem, key="--storage", file=storage)
        with _quiet():
            self._study.set_metric_names(list(axes))
        self.trials = []
        for frozen in self._study.get_trials(deepcopy=False):
            attributes, losses = frozen.user_attrs, tuple(frozen.values or ())
            values = self._values(frozen.params)
            self.trials.append(
                TuningTrial(values, attributes["parts"], losses, attributes["failed"], attributes["measures"])
            )

    def add(self, trial: TuningTrial) -> None:
        """Keep a trial; it is there whole, or not at all."""
        self._study.add_trial(self._frozen(trial))
        self.trials.append(trial)

    def space_filling(self, count: int, seed: int) -> list[dict[str, Any]]:
        """Values spread evenly over all ranges: scrambled Sobol points."""
        import optuna

        with _quiet():
            sampler = optuna.samplers.QMCSampler(qmc_type="sobol", scramble=True, seed=seed)
            return self._proposed(sampler, [], count)

    def promising(self, count: int, seed: int, made: Sequence[TuningTrial]) -> list[dict[str, Any]]:
        """Values where good ones are frequent among the known trials: the tree-structured Parzen estimator."""
        import optuna

        with _quiet():
            sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True, n_startup_trials=5)
            return self._proposed(sampler, made, count)

    def _proposed(
        self, sampler: optuna.samplers.BaseSampler, made: Sequence[TuningTrial], count: int
    ) -> list[dict[str, Any]]:
        import optuna

        # A study of its own: what it proposes depends on the known trials and the seed alone, however often the search
        # was interrupted.
        study = optuna.create_study(directions=self._directions, sampler=sampler)
        study.add_trials([self._frozen(trial) for trial in made])
        return [self._values(study.ask(self._distributions).params) for _ in range(count)]

    def _frozen(self, trial: TuningTrial) -> optuna.trial.FrozenTrial:
        import optuna

        state = optuna.trial.TrialState.COMPLETE if trial.losses else optuna.trial.TrialState.FAIL
        kept = {"parts": dict(trial.parts), "measures": dict(trial.measures), "failed": trial.failed}
        params = {
            item.key: json.dumps(trial.values[item.key]) if item.scale == "choice" else trial.values[item.key]
            for item in self._parameters
        }
        return optuna.trial.create_trial(
            state=state,
            values=list(trial.losses) or None,
            params=params,
            distributions=self._distributions,
            user_attrs=kept,
        )

    def _values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for item in self._parameters:
            value = params[item.key]
            if item.scale == "choice":
                value = json.loads(value)
            elif item.continuous:
                value = item.from_unit(item.to_unit(value))
            values[item.key] = value
        return values


@contextmanager
def _quiet() -> Iterator[None]:
    """Without Optuna's warnings that parts of it are new."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _open(name: str, storage: Path | None, directions: list[Direction]) -> optuna.Study:
    import optuna

    if storage is None:
        return optuna.create_study(directions=directions, study_name=name)
    from sqlalchemy import NullPool

    try:
        if storage.is_file() and storage.stat().st_size:
            open_tables(storage).close()
        with _quiet():
            return optuna.create_study(
                directions=directions,
                study_name=name,
                # Without a pool a connection is closed after each use: a study has no end at which to close it.
                storage=optuna.storages.RDBStorage(f"sqlite:///{storage}", engine_kwargs={"poolclass": NullPool}),
                load_if_exists=True,
            )
    except Exception as error:
        text = error.message if isinstance(error, InputError) else str(error)
        reason = text.splitlines()[0] if text else type(error).__name__
        raise InputError(f"is no study that can be written: {reason}", key="--storage", file=storage) from None
