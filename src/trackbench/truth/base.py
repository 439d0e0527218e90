"""Interface of a truth source: simulated, scripted or recorded motion, or a plug-in's."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

from pydantic import Field, PrivateAttr, model_validator

from trackbench.base.config import Config, problem_error
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Progress, RecordedDetections, RecordedMeasurements, Truth, no_progress

#: Recorded measurements, labelled or unlabelled.
Recorded = RecordedMeasurements | RecordedDetections
#: Largest number of scenes of one source.
MAX_SCENES = 1000


def distinct(values: list[Any]) -> list[Any]:
    """Return the list ``values``, each of which makes a scene; raise an error if a value is in it twice."""
    for index, value in enumerate(values):
        if value in values[:index]:
            raise problem_error(f"{value} is there already; each makes a scene of its own")
    return values


class Draw(NamedTuple):
    """Seed, scenario's name and number of runs, by which random motion is drawn, with a stream per run and object."""

    seed: int
    scenario: str
    runs: int


class LoadedTruth(NamedTuple):
    """Ground truth with its origin and, from a recording, its measurements."""

    truth: Truth
    cached: bool = False
    """Whether the truth was read from the cache."""
    notes: tuple[str, ...] = ()
    """Remarks on the recording, such as rows left out, one per line."""
    measurements: dict[str, Recorded] | None = None
    """Recorded measurements by name of the sensor; None if all measurements are to be synthesised."""


class TruthSource(Config, ABC):
    """Source of the true motion. The fields of a subclass are its options in a scenario."""

    #: Whether ``load`` takes too little time to be worth a process of its own.
    quick: ClassVar[bool] = False
    source: str = Field("", description="Where the true motion comes from.")
    _scene_name: str = PrivateAttr("")
    _others_within_m: float | None = PrivateAttr(None)

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        return {"source": TRUTH_SOURCES.name_of(cls), **data} if isinstance(data, dict) else data

    def scenes(self) -> Sequence[Self]:
        """Return a source for each scene; the source itself if there is only one.

        Scenes differ only in their motion: same sensors, same length, same number of runs.
        """
        return (self,)

    @property
    def scene_name(self) -> str:
        """Name that distinguishes the scene from the other scenes; empty for a single scene."""
        return self._scene_name

    def _with(self, **private: Any) -> Self:
        result = self.model_copy()
        for key, value in private.items():
            setattr(result, key, value)
        return result

    def stored(self) -> LoadedTruth | None:
        """Return the truth if it is available without simulation; None if ``load`` has to make it."""
        return None

    @abstractmethod
    def load(
        self,
        draw: Draw,
        *,
        folder: Path,
        sensors: Mapping[str, str] | None = None,
        cache: bool = True,
        progress: Progress = no_progress,
    ) -> LoadedTruth:
        """Return the ground truth; with several scenes, the truth of the first scene.

        Args:
            draw: seed, scenario and runs, by which random motion is drawn.
            folder: folder of the scenario, where relative paths start.
            sensors: kind (radar, lidar and so on) of each sensor, by name; a recording can have measurements of it.
            cache: whether a simulated truth is read from and written to the cache.
            progress: called with the number of simulated steps and the number of all steps.

        Raises:
            InputError: the truth cannot be made; the error's ``key`` names the option at fault, such as ``truth.env``.
        """

    def check(self, *, folder: Path | None = None, sensors: Mapping[str, str] | None = None) -> Sequence[str] | None:
        """Check everything that needs no simulation, beyond the validation of the options.

        Args:
            folder: folder of the scenario, where relative paths start; the working directory if None.
            sensors: kind (radar, lidar and so on) of each sensor, by name; a recording can have measurements of it.

        Returns:
            Remarks on the recording, as in ``LoadedTruth.notes``; None if the source has none.

        Raises:
            InputError: an option or a file is wrong, so that ``load`` would fail.
        """
        return None

    def recorded_rate(self, folder: Path) -> float | None:
        """Return the rate of recorded traffic, Hz, which no sensor's rate may exceed; None for any other source."""
        return None

    @property
    def counted_stretches(self) -> list[tuple[int, int]]:
        """Number of the log and of the stretch of time in it, for each scored stretch; empty if logs are not cut."""
        return []

    @property
    def random(self) -> bool:
        """Whether the motion differs from run to run."""
        return False

    @property
    def white_acceleration(self) -> float | None:
        """Standard deviation per axis of white acceleration, m/s^2, if it alone drives every object; else None."""
        return None

    def with_all_objects(self, within_m: float) -> Self:
        """Return a copy whose truth has all objects, not only targets, as hidden identities need.

        Args:
            within_m: distance from the observer, m, beyond which objects that are no targets may be left out.
        """
        return self._with(_others_within_m=within_m)

    @property
    def others_within_m(self) -> float | None:
        """Distance from the observer, m, beyond which non-targets may be missing; None if there are only targets."""
        return self._others_within_m

    def with_hidden_identities(self) -> Self:
        """Return a copy whose truth suits trackers that are not told which object a detection is from."""
        return self

    def feeds(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Return the part of ``kinds`` (type of sensor by name) for which the source has recorded measurements."""
        return {}


class SteppedTruth(TruthSource):
    """Truth source with a regular rate, which every sensor's rate must divide."""

    duration_s: float = Field(gt=0, le=3600, description="Length of the scene, s.")
    rate_hz: int = Field(
        ge=1, le=1000, description="Steps of the truth per second, Hz; every sensor's rate divides it."
    )


#: Truth sources by their names in scenarios.
TRUTH_SOURCES: Registry[type[TruthSource]] = Registry(
    "trackbench.truth_sources", "truth source", lacks_class(TruthSource)
)
