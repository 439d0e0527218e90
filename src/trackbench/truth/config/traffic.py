"""Options of recorded traffic, and of boxes and tracks in the same formats."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, PrivateAttr, Tag, model_validator

from trackbench.base.config import (
    LIST,
    MAPPING,
    WORD,
    Config,
    NonNegative,
    Positive,
    Problem,
    chosen_by,
    problem_error,
    text_or_list,
)
from trackbench.base.config.plugin import OptionsBeside, Plugin
from trackbench.truth.base import MAX_SCENES, TruthSource, distinct
from trackbench.truth.config.highway import ChosenTargets
from trackbench.truth.config.logs import Paths, find_log, log_names
from trackbench.truth.config.recording import FixedObserver, ReferenceTruth
from trackbench.truth.tracks import TRAFFIC_FORMATS, TrackRows, TrafficFormat, read_rows

FileFormat = Annotated[TrafficFormat, Plugin(TRAFFIC_FORMATS, "name", word=True)]
FORMAT = "The format of the file (`trackbench list truth` shows them), or one of your own as `module:Class`"
Vehicle = Annotated[str, Field(min_length=1)]


def files_in(path: str | list[str]) -> list[str]:
    """Return the value of a key with one path or several as a list."""
    return [path] if isinstance(path, str) else path


class VehicleObserver(Config):
    """Vehicle that carries the sensors, or several vehicles, each in a scene of its own."""

    vehicle: Annotated[
        Annotated[Vehicle, Tag(WORD)]
        | Annotated[list[Vehicle], Field(min_length=1, max_length=MAX_SCENES), AfterValidator(distinct), Tag(LIST)],
        chosen_by(
            text_or_list,
            'write the id of a vehicle as text, such as "12", or a list of ids, each of which makes a scene',
        ),
    ] = Field(
        description="Its id in the file, as text; or a list of ids, each of which makes a scene. The scenes may have "
        "no vehicle in common: an interval over scenes takes them for independent."
    )


def _observer_kind(value: Any) -> str | None:
    if isinstance(value, VehicleObserver) or (isinstance(value, dict) and "vehicle" in value):
        return "<vehicle>"
    return MAPPING if isinstance(value, dict | FixedObserver) else None


class Smoothing(Config):
    """Least-squares polynomial through the positions around each instant.

    Its slope is the velocity, and the integral of the velocity is the position, so that both agree.
    """

    window_s: float = Field(2.1, gt=0, le=60, description="Length of the window, centred on the instant, s.")
    order: int = Field(2, ge=1, le=5, description="Order of the polynomial.")


class TrafficOptions(TruthSource, OptionsBeside):
    """Options of traffic recorded from above or by a simulator, seen by sensors on a vehicle or at a point."""

    format: FileFormat = Field(description=f"{FORMAT}. Its options stand beside it.")
    path: str | None = Field(None, min_length=1, description="The file. None with i80, which comes with the package.")
    observer: Annotated[
        Annotated[FixedObserver, Tag(MAPPING)] | Annotated[VehicleObserver, Tag("<vehicle>")],
        chosen_by(_observer_kind, 'write {vehicle: "12"} or {x: 0, y: 0, yaw_deg: 0}'),
    ] = Field(description="What carries the sensors: a vehicle by its id, or a fixed point {x, y, yaw_deg}.")
    targets: ChosenTargets = "all"
    from_s: NonNegative = Field(0, description="Where the scene begins, s after the first row of the file.")
    duration_s: Annotated[float, Field(gt=0, le=3600)] | None = Field(
        None, description="Length of the scene, s; to the end of the file, or of the observer's track, unless given."
    )
    smoothing: Smoothing | None = Field(
        None,
        description="Smoothing of the positions. Default: none; speed and heading are then the file's, where it has "
        "them.",
    )
    audit: Literal["refuse", "repair"] = Field(
        "refuse",
        description="What to do with motion that no vehicle makes: refuse the recording with the figure, or take it as "
        "it is (repair: cut tracks where they jump; velocities that contradict the motion come from the displacement).",
    )
    length_m: Positive = Field(4.5, description="Length of a vehicle of which the file does not say it, m.")
    width_m: Positive = Field(1.8, description="Width of a vehicle of which the file does not say it, m.")
    _scene: int = PrivateAttr(0)

    @property
    def vehicles(self) -> list[str]:
        """Vehicles that carry the sensors, one for each scene; empty for a fixed observer."""
        if isinstance(self.observer, FixedObserver):
            return []
        return self.observer.vehicle if isinstance(self.observer.vehicle, list) else [self.observer.vehicle]

    @property
    def recording(self) -> Self:
        """Copy of the options without those in which scenes of a recording differ: observer, targets, scene number."""
        common = self.model_copy(update={"observer": FixedObserver(), "targets": "all"})
        return common._with(_scene=0, _others_within_m=None)

    @property
    def scene(self) -> int:
        """Number, from 0, of the scene that these options describe."""
        return self._scene

    @property
    def scene_name(self) -> str:
        return f"vehicle {self.vehicles[self._scene]}" if self.vehicles else ""

    def scenes(self) -> Sequence[Self]:
        return [self._with(_scene=number) for number in range(len(self.vehicles) or 1)]

    def problems(self) -> Iterator[Problem]:
        if self.format.endings and self.path is None:
            yield Problem(("path",), f"missing: the file, such as recording{self.format.endings[0]}")
        if not self.format.endings and self.path is not None:
            yield Problem(("path",), "this recording comes with the package; remove the path")


class BoxesOptions(ReferenceTruth, OptionsBeside):
    """Options of reference boxes in a file: each id is one object, due at the file's time stamps."""

    format: FileFormat = Field(description=f"{FORMAT}. Its options stand beside it.")
    path: Paths = Field(description="The file. Of several sequences a list of files, each of which is a scene.")

    @property
    def number_of_logs(self) -> int:
        return len(files_in(self.path))

    def scenes(self) -> Sequence[Self]:
        files = files_in(self.path)
        names = log_names(files) if len(files) > 1 else [""]
        sequences = zip(files, names, strict=True)
        return [self.model_copy(update={"path": file})._with(_scene_name=name) for file, name in sequences]

    @property
    def has_observer(self) -> bool:
        """Whether the position of the sensors is known: stated, or the origin of the format's frame."""
        return self.format.from_sensor or "observer" in self.model_fields_set

    def problems(self) -> Iterator[Problem]:
        if self.reference.range_m is not None and not self.has_observer:
            message = "counts from the observer, and the file does not say where that is: state it, such as "
            yield Problem(("reference", "range_m"), f"{message}observer: {{x: 0, y: 0}}")


AUTO = "auto"


class TracksConfig(OptionsBeside):
    """Options of tracks in a file, written by another program."""

    use: Literal["tracks"] = Field(description="tracks.")
    path: Paths = Field(description="The file. Or a list of files, one for each scene in the order of the scenes.")
    format: FileFormat = Field(
        description=f"{FORMAT}. Its options, such as columns and units, stand beside it. auto, or none: by the ending "
        "of the file, where it tells."
    )
    time_offset_s: float = Field(
        0,
        ge=-3600,
        le=3600,
        description="Added to the time stamps, s; negative where they are late. An offset is estimated and shown, and "
        "taken out by this alone.",
    )

    @model_validator(mode="before")
    @classmethod
    def _by_ending(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("format", AUTO) != AUTO:
            return data
        path = data.get("path")
        first = path[0] if isinstance(path, list) and path else path
        return {**data, "format": format_of(first)} if isinstance(first, str) else data

    @property
    def sensors(self) -> None:
        """Names of the tracker's sensors: None, since another program made the tracks."""

    @property
    def sensors_used(self) -> list[str]:
        """Names of the scenario's sensors that the tracker uses: none, since another program made the tracks."""
        return []


def format_of(path: str) -> str:
    """Return the name of the format for a file's ending.

    Raises:
        PydanticCustomError: no format has this ending, or several have it.
    """
    ending = PurePath(path).suffix.lower()
    names = [name for name, form in TRAFFIC_FORMATS.loaded().items() if ending in form.endings]
    if len(names) == 1:
        return names[0]
    what = f"the ending {ending!r}" if ending else "a name without an ending"
    fitting = names or sorted(TRAFFIC_FORMATS.loaded())
    raise problem_error(f"{what} does not tell the format; name it in format, such as {' or '.join(fitting)}")


def read_tracks(config: TracksConfig, name: str, folder: Path) -> list[TrackRows]:
    """Return the rows of each of a tracker's files, sorted by time.

    Args:
        config: the tracker's settings in the scenario.
        name: name of the tracker.
        folder: folder of the scenario, where a relative path starts.

    Raises:
        InputError: a file does not exist or is damaged.
    """
    files = [find_log(path, folder, f"trackers.{name}.path") for path in files_in(config.path)]
    return [read_rows(config.format, file).ordered(file) for file in files]
