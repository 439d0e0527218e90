"""The search for the best values: Optuna proposes them and keeps the trials."""

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

#: Name of the attribute that holds the values of a trial.
ATTRIBUTE = "tuning"
#: Significant digits of the start's results: fewer than the last bits, in which processors differ.
DIGITS = 6
#: Trials that are made between two looks at what was found.
BATCH = 6


def require_optuna() -> None:
    """Make sure that Optuna is installed.

    Raises:
        InputError: it is not; with the name of what installs it.
    """
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise InputError("tuning needs Optuna: pip install 'trackbench[tune]'") from None


def usual_trials(parameters: Sequence[Parameter]) -> int:
    """Return how many trials are made unless the user says."""
    return 20 + 40 * len(parameters)


def study_name(
    tracker: str, objective: str, parameters: Sequence[Parameter], seed: int, train: Sequence[Bench], start: list[Sums]
) -> str:
    """Return the name of the study of a tracker: equal for searches that make the same trials.

    Args:
        tracker: its name.
        objective: name of what it is tuned for.
        parameters: what is tuned.
        seed: of the search.
        train: the scenarios.
        start: what the tracker gives before it is tuned, by scenario; it tells of a changed log, plug-in or program.
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
    """The trials of one tracker.

    Args:
        name: of the study.
        storage: an SQLite file; None keeps the trials in memory.
        parameters: what is tuned.

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
        """Make trials until the study has so many; those that it has already are not made again.

        What a batch proposes depends on the trials before it and the seed, not on when the search was interrupted.

        Args:
            start: values that the search begins with; None begins with a random one.
            make: makes trials of values.
            count: of trials.
            seed: of what is drawn.
        """
        first, size = 0, 4 + 6 * len(self._parameters)
        while first < count:
            size, made = min(size, count - first), len(self._stored())
            if made < first + size:
                values = self._proposed(first, size, seed)
                if first == 0 and start is not None:
                    values = [dict(start), *values[:-1]]
                for trial in make(values[max(0, made - first) :]):
                    # A trial is in the study whole, or not at all.
                    self._study.add_trial(self._frozen(trial))
            first, size = first + size, BATCH

    def _proposed(self, first: int, size: int, seed: int) -> list[dict[str, Any]]:
        """Return scrambled Sobol points at first, then those of the tree-structured Parzen estimator."""
        import optuna

        drawn = int(np.random.SeedSequence([seed, first]).generate_state(1)[0])
        with _without_warnings():
            sampler: optuna.samplers.BaseSampler
            if first == 0:
                sampler = optuna.samplers.QMCSampler(qmc_type="sobol", scramble=True, seed=drawn)
            else:
                sampler = optuna.samplers.TPESampler(
                    seed=drawn, multivariate=True, constant_liar=True, n_startup_trials=5
                )
            # A study in memory: proposals that were not tried leave nothing in the file.
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
    """Return what Optuna draws for a value: the text of a choice, the odds of a probability, else the value."""
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
    """Silence Optuna's warnings that parts of it are new."""
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
                # Without a pool a connection is closed after each use: a study has no end at which to close it.
                storage=optuna.storages.RDBStorage(f"sqlite:///{storage}", engine_kwargs={"poolclass": NullPool}),
                load_if_exists=True,
            )
    except Exception as error:
        text = error.message if isinstance(error, InputError) else str(error)
        reason = text.splitlines()[0] if text else type(error).__name__
        raise InputError(f"is no study that can be written: {reason}", key="--storage", file=storage) from None
