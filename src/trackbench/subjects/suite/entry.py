"""An entry: a folder with a tracker's identity, its estimates, their scores, and the digest of every file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import AwareDatetime

from trackbench.base.errors import InputError, similar_path_hint
from trackbench.base.files import read_bytes
from trackbench.results.checks import why_other_content
from trackbench.results.folder import sha256
from trackbench.results.metric_value import ResultModel, model_of
from trackbench.subjects.suite.suite import Suite, find_suite

ENTRY, SCHEMA_VERSION = "entry.json", 1
#: File with the estimates of known objects, or the tracks, in every run of a scenario.
ESTIMATES = "estimates.parquet"


class SuiteIdentity(ResultModel):
    """Suite in which an entry was made: its id, its version and the digest of its file."""

    id: str
    version: int
    sha256: str
    """Digest of the suite's file."""


class TrackerIdentity(ResultModel):
    """Identity of a tracker, as its author states it, with the digest of its code."""

    name: str
    version: str
    licence: str
    source: str
    made: Literal["run here", "tracks"]
    """Origin of the estimates: a run on the machine of the entry, or tracks that an unknown program wrote."""
    options: dict[str, dict[str, Any]]
    """Settings of the tracker in a scenario's key ``trackers``, by kind of scenario: single or traffic."""
    sensors: dict[str, list[str] | None]
    """Names of the sensors that the tracker uses, by kind of scenario; None for all."""
    code: dict[str, str | None]
    """Digest of the tracker's own code, by kind of scenario; None if the code was not found."""
    random: bool
    """Whether the tracker states that it draws random numbers."""


class EnteredScenario(ResultModel):
    """Scenario of a suite that an entry covers: the scenario's id, and the command that runs it again."""

    id: str
    command: str


class Machine(ResultModel):
    """Machine on which an entry was made: system, number of cores, and versions of software."""

    system: str
    cores: int
    versions: dict[str, str]


class Entry(ResultModel):
    """Content of ``entry.json``: suite, tracker, scenarios with their digests, machine, and how the entry was made."""

    schema_version: Literal[1] = 1
    suite: SuiteIdentity
    tracker: TrackerIdentity
    scenarios: list[EnteredScenario]
    machine: Machine
    made_at: AwareDatetime
    commit: str | None
    """Commit of the repository that holds the tracker; None if unknown."""
    command: str
    files: dict[str, str]
    """Digest of each file of the entry except ``entry.json``, by path in the entry's folder."""
    sha256: str
    """Digest of all other values of ``entry.json``."""


def entry_digest(values: Mapping[str, Any]) -> str:
    """Return the sha256 of an entry's values, except its ``sha256``."""
    content = {key: value for key, value in values.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def digests_in(folder: Path) -> dict[str, str]:
    """Return the sha256 of each file of a folder except ``entry.json``, by path."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    names = {file.relative_to(folder).as_posix(): file for file in files}
    return {name: sha256(file) for name, file in names.items() if name != ENTRY}


@dataclass(frozen=True)
class StoredEntry:
    """Entry that was read from a folder: the content of its ``entry.json``, and the folder's path."""

    entry: Entry
    folder: Path
    is_whole: bool
    """Whether the values of ``entry.json`` have the sha256 that the file states."""
    suite_file: str | None = None
    """File of the suite; None for a suite that comes with the package."""

    @cached_property
    def suite(self) -> Suite:
        """Suite that the entry names.

        Raises:
            InputError: the suite is unknown.
        """
        return find_suite(self.suite_file or self.entry.suite.id)

    def file_problems(self) -> list[str]:
        """Return a message for each file that is changed, missing or not listed, and for a changed ``entry.json``."""
        problems = [] if self.is_whole else [f"{ENTRY}: its values have another sha256 than it states"]
        files = self.entry.files
        contents = {name: why_other_content(self.folder / name, digest) for name, digest in files.items()}
        problems += [f"{name}: {why}" for name, why in contents.items() if why is not None]
        problems += [f"{name}: {ENTRY} does not list it" for name in sorted({*digests_in(self.folder)} - {*files})]
        return problems


def read_entry(place: Path, suite: Path | None = None) -> StoredEntry:
    """Return the entry (a tracker's estimates and scores in a suite) that a folder holds.

    Args:
        place: folder of the entry, or its ``entry.json``.
        suite: file of the suite, if it does not come with the package.

    Raises:
        InputError: the entry is missing, unreadable or of another version.
    """
    if place.is_file() and place.name != ENTRY:
        raise InputError("this is a file; name the folder of an entry", file=place)
    file = place if place.name == ENTRY else place / ENTRY
    try:
        raw = json.loads(read_bytes(file))
    except FileNotFoundError:
        hint = similar_path_hint(place) if not place.exists() else "; `trackbench suite run` writes one"
        raise InputError(f"there is no {ENTRY}{hint}", file=place) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a readable entry: {error}", file=file) from error
    entry = model_of(Entry, raw, file, "entry of a suite", SCHEMA_VERSION)
    is_whole = entry.sha256 == entry_digest(raw)
    return StoredEntry(entry, file.parent, is_whole, None if suite is None else str(suite))
