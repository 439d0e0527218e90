"""The search for the best values: Optuna proposes values and stores the trials."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.subjects.tuning.entry import Values, plain
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.trials import TuningTrial

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

#: Name of the Optuna attribute with the values of a trial.
ATTRIBUTE = "tuning"
#: Significant digits of the start's results in the name of a study, since the last bits differ between processors.
DIGITS = 6
#: Number of trials that are proposed at once, before Optuna sees their losses.
BATCH = 6


def require_optuna() -> None:
    """Refuse to tune without Optuna.

    Raises:
        InputError: Optuna is not installed; the message has the command that installs it.
    """
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise InputError("tuning needs Optuna: pip install 'trackbench[tune]'") from None


def usual_trials(parameters: Sequence[Parameter]) -> int:
    """Return the default number of trials for tuning these parameters."""
    return 20 + 40 * len(parameters)


def study_name(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> str:
    """Return the name of the study of a tracker: equal for searches that make the same trials.

    Args:
        tracker: name of the tracker.
        objective: name of the objective.
        parameters: options to tune.
        seed: seed of the search.
        train: scenarios for tuning.
        start: sums of the start values by scenario, which reveal a changed log, plug-in or program.
    """
    settings: list[Any] = [objective, seed, [item.as_json() for item in parameters]]
    for bench, sums in zip(train, start, strict=True):
        config, document = bench.scenario.config, bench.scenario.document.value
        settings += [
            {key: value for key, value in document.items() if key not in ("trackers", "expect")},
            config.truth.model_dump(mode="json", fallback=str),
            config.monte_carlo.model_dump(mode="json"),
            plain(bench.scenario, tracker),
            {name: f"{sums.value(name):.{DIGITS}g}" for name in sums.measures},
        ]
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
    return f"{tracker} {digest[:16]}"


class Study:
    """Trials of one tracker, kept by Optuna in memory or in a file, and the search for better values.

    Args:
        name: name of the study.
        storage: SQLite file; None keeps the trials in memory.
        parameters: options to tune.

    Raises:
        InputError: the file cannot keep a study.
    """

    def __init__(self, name: str, storage: Path | None, parameters: Sequence[Parameter]) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._parameters = parameters
        self._distributions = {item.key: _distribution(item) for item in parameters}
        self._study = _open(name, storage)

    @property
    def trials(self) -> list[TuningTrial]:
        """All trials so far, in the order in which they were made."""
        return [
            TuningTrial(loss=math.inf if trial.value is None else trial.value, **trial.user_attrs[ATTRIBUTE])
            for trial in self._stored()
        ]

    def search(
        self,
        start: Values | None,
        make: Callable[[Sequence[Values]], list[TuningTrial]],
        count: int,
        seed: int,
    ) -> None:
        """Make trials until the study has ``count``; stored trials are not made again.

        The proposals of a batch depend on earlier trials and the seed, not on when the search was interrupted.

        Args:
            start: values of the first trial; None for random values.
            make: makes the trials of some values.
            count: number of trials.
            seed: seed of the random proposals.
        """
        first, size = 0, 4 + 6 * len(self._parameters)
        while first < count:
            size, finished = min(size, count - first), len(self._stored())
            if finished < first + size:
                values = self._propose(first, size, seed)
                if first == 0 and start is not None:
                    values = [dict(start), *values[:-1]]
                for trial in make(values[max(0, finished - first) :]):
                    # Only a finished trial is stored, so that an interruption leaves no half trial.
                    self._study.add_trial(self._frozen(trial))
            first, size = first + size, BATCH

    def _propose(self, first: int, size: int, seed: int) -> list[dict[str, Any]]:
        """Return scrambled Sobol points for the first batch, later proposals of a tree-structured Parzen estimator."""
        import optuna

        sampler_seed = int(np.random.SeedSequence([seed, first]).generate_state(1)[0])
        with _without_warnings():
            sampler: optuna.samplers.BaseSampler
            if first == 0:
                sampler = optuna.samplers.QMCSampler(qmc_type="sobol", scramble=True, seed=sampler_seed)
            else:
                sampler = optuna.samplers.TPESampler(
                    seed=sampler_seed, multivariate=True, constant_liar=True, n_startup_trials=5
                )
            # A study in memory, so that proposals that are never tried leave no trace in the file.
            study = optuna.create_study(sampler=sampler)
            study.add_trials(self._stored()[:first])
            return [self._values(study.ask(self._distributions).params) for _ in range(size)]

    def _stored(self) -> list[optuna.trial.FrozenTrial]:
        return self._study.get_trials(deepcopy=False)

    def _frozen(self, trial: TuningTrial) -> optuna.trial.FrozenTrial:
        import optuna

        attribute = {"values": dict(trial.values), "failed": trial.failed}
        return optuna.trial.create_trial(
            state=optuna.trial.TrialState.FAIL if trial.failed else optuna.trial.TrialState.COMPLETE,
            value=None if trial.failed else trial.loss,
            params={item.key: _param(item, trial.values[item.key]) for item in self._parameters},
            distributions=self._distributions,
            user_attrs={ATTRIBUTE: attribute},
        )

    def _values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        return {item.key: _value(item, params[item.key]) for item in self._parameters}


def _distribution(item: Parameter) -> BaseDistribution:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if item.scale == "choice":
        return CategoricalDistribution([_param(item, choice) for choice in item.choices])
    if item.scale == "integer":
        return IntDistribution(int(item.low), int(item.high))
    return FloatDistribution(_param(item, item.low), _param(item, item.high), log=item.scale != "linear")


def _param(item: Parameter, value: Any) -> Any:
    """Return a value as Optuna's parameter: the text of a choice, the odds of a probability, else the number."""
    if item.scale == "choice":
        return json.dumps(value)
    return value / (1.0 - value) if item.scale == "odds" else value


def _value(item: Parameter, param: Any) -> Any:
    if item.scale == "choice":
        return json.loads(param)
    if item.scale == "integer":
        return param
    return item.rounded(param / (1.0 + param) if item.scale == "odds" else param)


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Silence Optuna's warnings about experimental features."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _open(name: str, storage: Path | None) -> optuna.Study:
    import optuna

    if storage is None:
        return optuna.create_study(study_name=name)
    from sqlalchemy import NullPool

    try:
        with _without_warnings():
            return optuna.create_study(
                study_name=name,
                # Without a pool each connection is closed after use; a study has no end at which to close a pool.
                storage=optuna.storages.RDBStorage(f"sqlite:///{storage}", engine_kwargs={"poolclass": NullPool}),
                load_if_exists=True,
            )
    except Exception as error:
        text = error.message if isinstance(error, InputError) else str(error)
        reason = text.splitlines()[0] if text else type(error).__name__
        raise InputError(f"is no study that can be written: {reason}", key="--storage", file=storage) from None
