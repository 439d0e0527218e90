"""What a truth source is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

from pydantic import Field, model_validator

from trackbench.base.config import Config
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Progress, RecordedDetections, RecordedMeasurements, Truth, no_progress

#: Recorded measurements, labelled or unlabelled.
Recorded = RecordedMeasurements | RecordedDetections
#: Largest number of scenes of one source.
MAX_SCENES = 1000


class Draw(NamedTuple):
    """What random motion is drawn by: ``streams.stream(seed, scenario, run, "motion of <object>")``."""

    seed: int
    scenario: str
    runs: int


class LoadedTruth(NamedTuple):
    """A truth and how it was come by."""

    truth: Truth
    cached: bool = False
    """Whether it was read from the cache."""
    notes: tuple[str, ...] = ()
    """What was left out of a recording, a line each."""
    measurements: dict[str, Recorded] | None = None
    """By sensor; None where measurements are to be synthesised."""


class TruthSource(Config, ABC):
    """Where the true motion comes from. The fields of a subclass are its options in a scenario."""

    source: str = Field("", description="Where the true motion comes from.")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        return {"source": TRUTH_SOURCES.name_of(cls), **data} if isinstance(data, dict) else data

    def scenes(self) -> Sequence[Self]:
        """Each scene as a source of its own; the source itself, where it has only one.

        Scenes differ in their motion and nothing else: same sensors, same length, same number of runs.
        """
        return (self,)

    @property
    def scene_name(self) -> str:
        """What tells it from the other scenes; empty where nothing does."""
        return ""

    def stored(self) -> LoadedTruth | None:
        """The truth, where it is at hand without being made; None where ``load`` has to make it."""
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
        """The truth that these options describe; of several scenes, that of the first.

        Args:
            draw: what random motion is drawn by.
            folder: the scenario's, where relative paths start.
            sensors: the kind of each of the scenario's sensors, which a recording may feed.
            cache: whether a simulated truth is read from the cache and kept there.
            progress: called with the number of steps simulated and of all.

        Raises:
            InputError: it cannot be had; ``key`` names the option at fault (``truth.env``).
        """

    def check(self, *, folder: Path | None = None, sensors: Mapping[str, str] | None = None) -> Sequence[str] | None:
        """Check everything that can be checked without simulating, as far as the options alone do not show it.

        Args:
            folder: the scenario's, where relative paths start; the working directory unless given.
            sensors: the kind of each of the scenario's sensors, which a recording may feed.

        Returns:
            What a recording implies and what is left out of it, a line each, as the notes of ``load``.

        Raises:
            InputError: as in ``load``.
        """
        return None

    def recorded_rate(self, folder: Path) -> float | None:
        """Instants per second of recorded traffic, Hz, which no sensor exceeds; else None. Errors as of ``load``."""
        return None

    @property
    def counted_stretches(self) -> list[tuple[int, int]]:
        """Number of the log, and that of the stretch in it, of each that counts; none where logs are not cut."""
        return []

    @property
    def quick(self) -> bool:
        """Whether ``load`` takes so little time that it is not worth another process."""
        return False

    @property
    def random(self) -> bool:
        """Whether the motion differs from run to run."""
        return False

    @property
    def white_acceleration(self) -> float | None:
        """Standard deviation per axis, m/s^2, of an acceleration drawn anew at each step of the truth, if nothing else
        drives any object; else None."""
        return None

    def with_all_objects(self, within_m: float) -> Self:
        """The source whose truth has every object, with ``Truth.target``: for hidden identities.

        Args:
            within_m: an object that is no target and never comes this near to the observer may be left out. It is
                the option ``others_within_m`` of those that have one, unless that is stated.
        """
        if getattr(self, "others_within_m", within_m) is not None:
            return self
        return self.model_copy(update={"others_within_m": within_m})

    def with_hidden_identities(self) -> Self:
        """The source where nothing tells trackers of which object a detection is."""
        return self

    def feeds(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Those of the sensors, given by name with their kinds, whose measurements the source has."""
        return {}


class SteppedTruth(TruthSource):
    """A truth source that makes its motion at a regular rate, into which the sensors' rates have to fit."""

    duration_s: float = Field(gt=0, le=3600, description="Length of the scene, s.")
    rate_hz: int = Field(
        ge=1, le=1000, description="Steps of the truth per second, Hz; every sensor's rate divides it."
    )


#: The truth sources by the names that scenarios use.
TRUTH_SOURCES: Registry[type[TruthSource]] = Registry(
    "trackbench.truth_sources", "truth source", lacks_class(TruthSource)
)
