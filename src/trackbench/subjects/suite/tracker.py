"""Trackers that enter a suite, by name, class or file; and the tracks that a closed one wrote."""

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

#: Endings of files of tracks.
ENDINGS = (".parquet", ".csv")


class TrackerFile(Config):
    """The file of a tracker: who it is, and what follows single objects or traffic."""

    name: Name
    version: str = ""
    licence: str = ""
    source: str = Field("", description="Where its code or its paper is found.")
    single: dict[str, Any] | None = Field(None, description="A tracker of single objects, as a scenario has it.")
    traffic: dict[str, Any] | None = Field(None, description="A tracker of several objects, as a scenario has it.")
    tracks: str | None = Field(
        None, description="A folder of tracks that it wrote for exported scans, a file for each scenario's id."
    )

    def problems(self) -> Iterator[Problem]:
        stated = [key for key in (*KINDS, "tracks") if getattr(self, key) is not None]
        if not stated:
            yield Problem((), "the tracker is missing: write single, traffic, or tracks (a folder of finished tracks)")
        if self.tracks is not None and len(stated) > 1:
            yield Problem(("tracks",), f"stands beside {stated[0]}; remove one of them")


@dataclass(frozen=True)
class EnteringTracker:
    """A tracker, and where its files are."""

    stated: TrackerFile
    folder: Path
    named: str
    """Argument that names the tracker on the command line."""
    file: Path | None = None
    """YAML file of the tracker."""

    @property
    def name(self) -> str:
        """Name of the tracker, and of the folder of its entry."""
        return self.stated.name

    def entry(self, kind: Kind) -> dict[str, Any] | None:
        """Return what follows single objects, or traffic; None where nothing does."""
        found: dict[str, Any] | None = getattr(self.stated, kind)
        return found

    def tracks_of(self, scenario: SuiteScenario) -> Path | None:
        """Return the file of its finished tracks of a scenario; None where there is none."""
        if self.stated.tracks is None:
            return None
        files = [self.folder / self.stated.tracks / f"{scenario.id}{ending}" for ending in ENDINGS]
        return next((file for file in files if file.is_file()), None)

    def scenarios(self, chosen: list[SuiteScenario]) -> list[SuiteScenario]:
        """Return those of some scenarios that it can enter.

        Raises:
            InputError: it can enter none.
        """
        if self.stated.tracks is not None:
            folder, ids = self.folder / self.stated.tracks, chosen[0].suite.scenarios
            for file in sorted(folder.glob("*")):
                if file.suffix in ENDINGS and file.stem not in ids:
                    raise InputError(f"not the id of a scenario; {nearest_choices(file.stem, ids)}", file=file)
            kept = [item for item in chosen if self.tracks_of(item) is not None]
            message = f"there is no file of tracks in {folder}, such as {chosen[0].id}.csv"
        else:
            kept = [item for item in chosen if self.entry(item.kind) is not None]
            message = f"has no key {chosen[0].kind}, and the chosen scenarios are of that kind"
        if not kept:
            raise InputError(message, file=self.file or self.named)
        return kept

    def located(self, error: InputError, kind: Kind) -> InputError:
        """Return an error of a scenario as one of the tracker's file."""
        key = f"{kind}{(error.key or '').removeprefix(f'trackers.{self.name}')}"
        return InputError(error.message, key=key, file=self.file or self.named)


def find_tracker(named: str, suite: Suite) -> EnteringTracker:
    """Return the tracker that an argument names: a built-in one of the suite, a YAML file or ``module:Class``.

    Raises:
        InputError: it is none of these, or something is wrong in the file.
    """
    built_in = suite.stated.trackers
    if entries := {kind: entries[named] for kind, entries in built_in.items() if named in entries}:
        from importlib.metadata import version

        identity = {"version": f"trackbench {version('trackbench')}", "licence": "MIT", "source": "trackbench"}
        stated = TrackerFile.model_validate({"name": named, **identity, **entries})
        return EnteringTracker(stated, Path.cwd(), named)
    path = Path(named)
    if path.suffix in (".yaml", ".yml"):
        stated, _ = read_config(TrackerFile, path)
        return EnteringTracker(stated, path.resolve().parent, named, path)
    if re.fullmatch(r"[\w.]+:\w+", named):
        name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", named.rpartition(":")[2].lstrip("_")).lower()[:64]
        return EnteringTracker(TrackerFile(name=name, single={"use": named}), Path.cwd(), named)
    names = (name for entries in built_in.values() for name in entries)
    hint = f"{nearest_choices(named, names)}, a file such as mine.yaml, or module:Class"
    raise InputError(f"there is no tracker {named!r}; {hint}", key="TRACKER")
