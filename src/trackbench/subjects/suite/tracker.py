"""Trackers that enter a suite, by name, class or file, or by finished tracks of a program that is not here."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from trackbench.base.config import Config, Name, Problem
from trackbench.base.errors import InputError, nearest_choices
from trackbench.scenario.config_file import read_config
from trackbench.subjects.suite.suite import KINDS, Kind, Suite, SuiteScenario

#: Endings of files with tracks.
ENDINGS = (".parquet", ".csv")


class TrackerFile(Config):
    """Keys of a tracker's file: identity, and settings for single objects or traffic, or a folder of tracks."""

    name: Name
    version: str = ""
    licence: str = ""
    source: str = Field("", description="Address of the code or of a paper.")
    single: dict[str, Any] | None = Field(None, description="Tracker of single objects, as in a scenario.")
    traffic: dict[str, Any] | None = Field(None, description="Tracker of several objects, as in a scenario.")
    tracks: str | None = Field(
        None, description="Folder of finished tracks for exported scans, with a file for each scenario's id."
    )

    def problems(self) -> Iterator[Problem]:
        stated = [key for key in (*KINDS, "tracks") if getattr(self, key) is not None]
        if not stated:
            yield Problem((), "add a tracker as single or traffic, or a folder of finished tracks as tracks")
        if self.tracks is not None and len(stated) > 1:
            yield Problem(("tracks",), f"stands beside {stated[0]}; remove one of them")


@dataclass(frozen=True)
class EnteringTracker:
    """Tracker that is to enter a suite: its settings and identity, and the folder of its files."""

    stated: TrackerFile
    folder: Path
    argument: str
    """Argument that names the tracker on the command line."""
    file: Path | None = None
    """YAML file of the tracker; None for a built-in tracker or a class."""

    @property
    def name(self) -> str:
        """Name of the tracker, and of the folder of its entry."""
        return self.stated.name

    def entry(self, kind: Kind) -> dict[str, Any] | None:
        """Return the tracker's settings for a kind of scenario, single or traffic; None if it has none for it."""
        entry: dict[str, Any] | None = getattr(self.stated, kind)
        return entry

    def tracks_of(self, scenario: SuiteScenario) -> Path | None:
        """Return the file of finished tracks of a scenario, or None if it does not exist."""
        if self.stated.tracks is None:
            return None
        files = [self.folder / self.stated.tracks / f"{scenario.id}{ending}" for ending in ENDINGS]
        return next((file for file in files if file.is_file()), None)

    def scenarios(self, chosen: list[SuiteScenario]) -> list[SuiteScenario]:
        """Return the chosen scenarios that the tracker can enter.

        Raises:
            InputError: the tracker can enter none of them.
        """
        if self.stated.tracks is not None:
            folder, ids = self.folder / self.stated.tracks, chosen[0].suite.scenarios
            for file in sorted(folder.glob("*")):
                if file.suffix in ENDINGS and file.stem not in ids:
                    raise InputError(f"not the id of a scenario; {nearest_choices(file.stem, ids)}", file=file)
            entered = [item for item in chosen if self.tracks_of(item) is not None]
            message = f"there is no file of tracks in {folder}, such as {chosen[0].id}.csv"
        else:
            entered = [item for item in chosen if self.entry(item.kind) is not None]
            message = f"has no key {chosen[0].kind}, and the chosen scenarios are of that kind"
        if not entered:
            raise InputError(message, file=self.file or self.argument)
        return entered

    def located(self, error: InputError, kind: Kind) -> InputError:
        """Return an error in a scenario's key ``trackers`` as an error in the tracker's file."""
        key = f"{kind}{(error.key or '').removeprefix(f'trackers.{self.name}')}"
        return InputError(error.message, key=key, file=self.file or self.argument)


def find_tracker(argument: str, suite: Suite) -> EnteringTracker:
    """Return the tracker that an argument names: a built-in tracker of the suite, a YAML file or ``module:Class``.

    Raises:
        InputError: the argument is none of these, or the file has an error.
    """
    built_in = suite.stated.trackers
    if entries := {kind: entries[argument] for kind, entries in built_in.items() if argument in entries}:
        from importlib.metadata import version

        identity = {"version": f"trackbench {version('trackbench')}", "licence": "MIT", "source": "trackbench"}
        stated = TrackerFile.model_validate({"name": argument, **identity, **entries})
        return EnteringTracker(stated, Path.cwd(), argument)
    path = Path(argument)
    if path.suffix in (".yaml", ".yml"):
        stated, _ = read_config(TrackerFile, path)
        return EnteringTracker(stated, path.resolve().parent, argument, path)
    if re.fullmatch(r"[\w.]+:\w+", argument):
        name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", argument.rpartition(":")[2].lstrip("_")).lower()[:64]
        return EnteringTracker(TrackerFile(name=name, single={"use": argument}), Path.cwd(), argument)
    names = (name for entries in built_in.values() for name in entries)
    hint = f"{nearest_choices(argument, names)}, a file such as mine.yaml, or module:Class"
    raise InputError(f"there is no tracker {argument!r}; {hint}", key="TRACKER")
