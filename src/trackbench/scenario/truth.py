"""Ground truth of each scene of a scenario: simulated, scripted, drawn at random or read from a file."""

from __future__ import annotations

from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.types import Progress, no_progress
from trackbench.scenario.load import Scenario, own_folder
from trackbench.sensing.view import sensor_reach
from trackbench.truth import Draw, LoadedTruth, TruthSource
from trackbench.truth.jumps import LARGEST


def truth_of(loaded: Scenario, progress: Progress = no_progress) -> LoadedTruth:
    """Return the ground truth of the first scene: simulated traffic, scripted motion, or motion read from a file."""
    try:
        first = _load(_setting(loaded), truth_source(loaded), progress)
        require_rates(loaded)
        return first
    except InputError as error:
        raise loaded.locate(error) from None


def truths_of(
    loaded: Scenario, progress: Progress = no_progress, executor: Executor | None = None
) -> list[LoadedTruth]:
    """Return the truth of each scene: simulated, scripted, drawn at random or read; in the order of the scenes.

    Args:
        loaded: the scenario.
        progress: called with the number of simulated steps and of all steps; with an executor, once per scene.
        executor: simulates the truths that are not in the cache; None to simulate in this process.

    Raises:
        InputError: a truth cannot be made; with file and line.
        TrackbenchError: the processes that simulate died.
    """
    return PendingTruths(loaded, executor or Executor()).collect(progress)


def truth_source(loaded: Scenario) -> TruthSource:
    """Return the truth source; with hidden identities or occlusion, it has every object that a sensor can reach."""
    config = loaded.config
    if config.sensing.identities == "known" and not config.hides_targets:
        return config.truth
    return own_source(loaded).with_all_objects(min(sensor_reach(config.sensors.values()), LARGEST["length"]))


def own_source(loaded: Scenario) -> TruthSource:
    """Return the truth source as the scenario configures it, set to hidden identities if they are hidden."""
    truth = loaded.config.truth
    return truth.with_hidden_identities() if loaded.config.sensing.identities == "hidden" else truth


def require_rates(loaded: Scenario) -> None:
    """Read the rate of recorded traffic, and raise an error if a sensor's rate is higher.

    Raises:
        InputError: a sensor's rate is higher.
    """
    recorded_hz = own_source(loaded).recorded_rate(loaded.folder)
    for name, sensor in loaded.config.sensors.items():
        if recorded_hz is not None and sensor.rate_hz is not None and sensor.rate_hz > recorded_hz * (1 + 1e-6):
            more = f"{sensor.rate_hz:g} Hz is more than the truth has, which is recorded at {recorded_hz:g} Hz"
            units = "" if recorded_hz >= 1 else "check the unit of its times, such as time: t:ms; or "
            raise InputError(f"{more}; {units}use {recorded_hz:g}", key=f"sensors.{name}.rate_hz")


class PendingTruths:
    """Truths of a scenario's scenes, whose simulation begins when this is made; ``collect`` waits for them.

    Args:
        loaded: the scenario.
        executor: simulates the truths that are not in the cache.
    """

    def __init__(self, loaded: Scenario, executor: Executor) -> None:
        self._loaded = loaded
        self._made = 0
        self._progress: Progress = no_progress
        sources = truth_source(loaded).scenes()
        self._stored = [source.stored() for source in sources]
        missing = [source for source, stored in zip(sources, self._stored, strict=True) if stored is None]
        self._missing = len(missing)
        if all(source.quick for source in missing):
            executor = Executor()
        setting = _setting(loaded)
        calls = [(setting, source) for source in missing]
        self._simulated = executor.map(_load, calls, own_folder(loaded), (self._advance,))

    def collect(self, progress: Progress = no_progress) -> list[LoadedTruth]:
        """Wait for the truths and return them in the order of the scenes."""
        self._progress = progress
        return [
            self._next(i) if stored is None else _as_sensed(stored, self._loaded.config.hides_targets)
            for i, stored in enumerate(self._stored, 1)
        ]

    def _next(self, number: int) -> LoadedTruth:
        try:
            result: LoadedTruth = next(self._simulated)
            require_rates(self._loaded)
        except InputError as error:
            if len(self._stored) > 1:
                message = f"scene {number} of {len(self._stored)}: {error.message}"
                error = InputError(message, key=error.key, file=error.file, line=error.line)
            raise self._loaded.locate(error) from None
        steps = len(result.truth.time)
        self._advance(steps, steps)
        self._made += 1
        return result

    def _advance(self, done: float, total: float) -> None:
        self._progress(self._made * total + done, self._missing * total)


#: The draw, the scenario's folder, the kind of each sensor by name, and whether objects hide others.
_Setting = tuple[Draw, Path, dict[str, str], bool]


def _setting(loaded: Scenario) -> _Setting:
    config = loaded.config
    draw = Draw(config.monte_carlo.seed, config.name, config.monte_carlo.runs)
    return draw, loaded.folder, config.sensor_kinds, config.hides_targets


def _load(setting: _Setting, source: TruthSource, progress: Progress = no_progress) -> LoadedTruth:
    draw, folder, kinds, hides = setting
    return _as_sensed(source.load(draw, folder=folder, sensors=kinds, progress=progress), hides)


def _as_sensed(loaded: LoadedTruth, hides: bool) -> LoadedTruth:
    return loaded._replace(truth=loaded.truth.with_hiders()) if hides else loaded
