"""The trials in an Optuna study: in memory, or in a file in which they stay."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from trackbench.base.errors import InputError
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.signature import differences
from trackbench.subjects.tuning.trials import TuningTrial

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution

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

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._parameters = parameters
        self._distributions = {item.key: _distribution(item) for item in parameters}
        self._directions: list[Direction] = ["minimize"] * len(axes)
        self._study = _open(name, storage, self._directions)
        _require_same(self._study, signature, name, storage)
        with _quiet():
            self._study.set_metric_names(list(axes))
        self.trials = [self._trial(item) for item in self._study.get_trials(deepcopy=False)]

    def add(self, trial: TuningTrial) -> None:
        """Keep a trial; it is there whole, or not at all."""
        self._study.add_trial(self._frozen(trial))
        self.trials.append(trial)

    def space_filling(self, count: int, seed: int) -> list[dict[str, Any]]:
        """Values spread evenly over all ranges: scrambled Sobol points."""
        import optuna

        with _quiet():
            sampler = optuna.samplers.QMCSampler(qmc_type="sobol", scramble=True, seed=seed)
            return self._asked(sampler, [], count)

    def promising(self, count: int, seed: int, known: Sequence[TuningTrial]) -> list[dict[str, Any]]:
        """Values where good ones are frequent among the known trials: the tree-structured Parzen estimator."""
        import optuna

        with _quiet():
            sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True, n_startup_trials=5)
            return self._asked(sampler, known, count)

    def _asked(
        self, sampler: optuna.samplers.BaseSampler, known: Sequence[TuningTrial], count: int
    ) -> list[dict[str, Any]]:
        import optuna

        # A study of its own: what it proposes depends on the known trials and the seed alone, however often the search
        # was interrupted.
        study = optuna.create_study(directions=self._directions, sampler=sampler)
        study.add_trials([self._frozen(trial) for trial in known])
        return [self._values(study.ask(self._distributions).params) for _ in range(count)]

    def _frozen(self, trial: TuningTrial) -> optuna.trial.FrozenTrial:
        import optuna

        state = optuna.trial.TrialState.COMPLETE if trial.losses else optuna.trial.TrialState.FAIL
        kept = {"parts": dict(trial.parts), "measures": dict(trial.measures), "failed": trial.failed}
        params = {item.key: _to_optuna(item, trial.values[item.key]) for item in self._parameters}
        return optuna.trial.create_trial(
            state=state,
            values=list(trial.losses) or None,
            params=params,
            distributions=self._distributions,
            user_attrs=kept,
        )

    def _trial(self, frozen: optuna.trial.FrozenTrial) -> TuningTrial:
        kept = frozen.user_attrs
        losses = tuple(frozen.values or ())
        return TuningTrial(self._values(frozen.params), kept["parts"], losses, kept["failed"], kept["measures"])

    def _values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        return {item.key: _from_optuna(item, params[item.key]) for item in self._parameters}


@contextmanager
def _quiet() -> Iterator[None]:
    """Without Optuna's warnings that parts of it are new."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _distribution(item: Parameter) -> BaseDistribution:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if item.scale == "choice":
        return CategoricalDistribution([json.dumps(choice) for choice in item.choices])
    if item.scale == "integer":
        return IntDistribution(int(item.low), int(item.high))
    return FloatDistribution(item.low, item.high, log=item.scale == "log")


def _to_optuna(item: Parameter, value: Any) -> Any:
    return json.dumps(value) if item.scale == "choice" else value


def _from_optuna(item: Parameter, value: Any) -> Any:
    if item.scale == "choice":
        return json.loads(value)
    return item.from_unit(item.to_unit(value)) if item.continuous else value


def _open(name: str, storage: Path | None, directions: list[Direction]) -> optuna.Study:
    import optuna
    from sqlalchemy import NullPool

    if storage is None:
        return optuna.create_study(directions=directions, study_name=name)
    try:
        with _quiet():
            return optuna.create_study(
                directions=directions,
                study_name=name,
                # Without a pool a connection is closed after each use: a study has no end at which to close it.
                storage=optuna.storages.RDBStorage(f"sqlite:///{storage}", engine_kwargs={"poolclass": NullPool}),
                load_if_exists=True,
            )
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"is no study that can be written: {reason}", key="--storage", file=storage) from None


def _require_same(study: optuna.Study, signature: Mapping[str, Any], name: str, storage: Path | None) -> None:
    kept = study.user_attrs.get(SIGNATURE)
    if kept is None:
        if study.get_trials(deepcopy=False):
            raise InputError(f"its study {name!r} is of another program", key="--storage", file=storage)
        study.set_user_attr(SIGNATURE, dict(signature))
        return
    differs = differences(kept, json.loads(json.dumps(signature)))
    if differs:
        raise InputError(
            f"its study {name!r} is of another search: {differs}; give another file", key="--storage", file=storage
        )
