"""Built-in sources of truth: each joins its options with the code that loads it.

The simulator and the readers of files take a second to import, so they are imported only when needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from trackbench.base.types import Progress, no_progress
from trackbench.truth import scripted, simulated
from trackbench.truth.base import Draw, LoadedTruth, TruthSource
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.config.recording import RecordingOptions
from trackbench.truth.config.scripted import ScriptedOptions
from trackbench.truth.config.traffic import BoxesOptions, TrafficOptions

#: Placeholder for a recording, which has no random motion.
_ANY_DRAW = Draw(0, "", 1)


class HighwayTruth(HighwayOptions):
    """Traffic simulated by highway-env."""

    def load(self, draw: Draw, *, cache: bool = True, progress: Progress = no_progress, **_: Any) -> LoadedTruth:
        return simulated.load_simulated(self.scenes()[0], cache, progress)

    def stored(self) -> LoadedTruth | None:
        return simulated.stored(self.scenes()[0])

    def check(self, *, folder: Path | None = None, sensors: Mapping[str, str] | None = None) -> None:
        # A cached truth has already been simulated with these options and versions.
        if self.stored() is None:
            from trackbench.truth import highway

            highway.validate(self.scenes()[0])


class ScriptedTruth(ScriptedOptions):
    """Scripted motion, exact in position and velocity."""

    quick: ClassVar[bool] = True

    def load(self, draw: Draw, **_: Any) -> LoadedTruth:
        return LoadedTruth(scripted.script(self, *draw))


class _Recorded(TruthSource):
    """Base of the truth sources that read their motion from files."""

    quick: ClassVar[bool] = True

    def check(self, *, folder: Path | None = None, sensors: Mapping[str, str] | None = None) -> list[str]:
        loaded = (scene.load(_ANY_DRAW, folder=folder or Path(), sensors=sensors) for scene in self.scenes())
        return [note for scene in loaded for note in scene.notes]


class RecordingTruth(_Recorded, RecordingOptions):
    """Motion from files, with measurements if the files have them; each log is a scene."""

    def load(self, draw: Draw, *, folder: Path, sensors: Mapping[str, str] | None = None, **_: Any) -> LoadedTruth:
        from trackbench.truth import recorded

        loaded = recorded.load_recording(self.scenes()[0], sensors or {}, folder)
        scene = f"{self.scene_name}: " if self.scene_name else ""
        return loaded._replace(notes=tuple(scene + note for note in loaded.notes))


class BoxesTruth(_Recorded, BoxesOptions):
    """Boxes in a file, against which tracks in other files are scored."""

    def load(self, draw: Draw, *, folder: Path, sensors: Mapping[str, str] | None = None, **_: Any) -> LoadedTruth:
        from trackbench.truth import boxes

        return LoadedTruth(boxes.load_boxes(self.scenes()[0], folder, sensors=bool(sensors)))


class TrafficTruth(_Recorded, TrafficOptions):
    """Recorded traffic, seen by sensors on one of its vehicles or beside the road."""

    def load(self, draw: Draw, *, folder: Path, **_: Any) -> LoadedTruth:
        from trackbench.truth import traffic

        truth, note = traffic.load_traffic(self, folder)
        return LoadedTruth(truth, notes=(f"recording: {note}",) if self.scene == 0 else ())

    def recorded_rate(self, folder: Path) -> float:
        from trackbench.truth import traffic

        return traffic.recording_rate(self, folder)
