"""Provenance of a result: time, git commit, and sha256 of the user's trackers and of files."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from trackbench.base.files import read_bytes
from trackbench.base.plugins import searched
from trackbench.results.summary import Provenance
from trackbench.scenario import Scenario
from trackbench.scenario.load import texts_of
from trackbench.scenario.shipped import is_shipped
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.published import TRACKERS

#: Longest time that git may take, s.
PATIENCE = 20.0


def provenance_of(loaded: Scenario) -> Provenance:
    """Return the provenance of a scenario that is about to run."""
    made_at = datetime.now(UTC)
    commit, changed, reason = _commit(loaded.path.resolve())
    code = code_of_trackers(loaded)
    return Provenance(made_at=made_at, commit=commit, changed=changed, no_commit=reason, code=code)


class _GitError(Exception):
    """Error: git cannot be asked; the message says why."""


def _commit(scenario: Path) -> tuple[str | None, bool | None, str]:
    """Return the commit of a scenario's repository, whether files differ from it, and the reason if there is none."""
    if is_shipped(scenario):
        return None, None, "the scenario comes with trackbench"
    folder = scenario.parent
    try:
        commit = _git(folder, "rev-parse", "--verify", "HEAD")
        if scenario.is_file() and not _git(folder, "ls-files", "--", scenario.name):
            return None, None, f"{scenario.name} is not in its git repository"
        return commit, bool(_git(folder, "status", "--porcelain", "--untracked-files=no")), ""
    except _GitError as error:
        return None, None, str(error)


def _git(folder: Path, *arguments: str) -> str:
    """Return the output of a git command in a folder.

    Raises:
        _GitError: git is not installed, or fails.
    """
    environment = os.environ | {"LC_ALL": "C", "GIT_OPTIONAL_LOCKS": "0"}
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        raise _GitError(f"git gave no answer within {PATIENCE:g} s") from None
    except OSError as error:
        raise _GitError(f"git cannot be run: {error.strerror}") from None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["it failed"]
        raise _GitError(f"git: {lines[0].removeprefix('fatal: ')}")
    return done.stdout.decode(errors="replace").strip()


#: Reference to something in a module, ``module:name``.
_REFERENCE = re.compile(r"[^\W\d][\w.]*:[^\W\d][\w.]*")


def code_of_trackers(loaded: Scenario) -> dict[str, str | None]:
    """Return the sha256 of each user-written tracker's code, by name of the tracker; None if no file is found."""
    folder, code = loaded.folder, {}
    for name, tracker in loaded.config.trackers.items():
        references = {*_references(loaded.document.value["trackers"][name])}
        use = tracker.reference if isinstance(tracker, PluginConfig) else ""
        is_own = isinstance(tracker, PluginConfig) and not TRACKERS.home_of(use).startswith("trackbench.")
        if is_own and use:
            references.add(f"{TRACKERS.home_of(use)}:")
        sources = dict(filter(None, (_source(reference, folder) for reference in references)))
        if isinstance(tracker, PluginConfig) and not isinstance(tracker.use, str):
            sources |= {str(file): file.read_bytes() for file in tracker.use.files(folder)}
        if is_own or sources:
            code[name] = _sha256(sources)
    return code


def _references(entry: Any) -> Iterator[str]:
    """Yield the texts in a tracker's settings that name a module outside trackbench, such as ``mine:Tracker``."""
    return (text for text in texts_of(entry) if _REFERENCE.fullmatch(text) and not text.startswith("trackbench."))


def _sha256(sources: Mapping[str, bytes]) -> str | None:
    """Return the sha256 of a source; of several, the sha256 of their hashes joined by name; None without a source."""
    digests = [hashlib.sha256(content).hexdigest() for _, content in sorted(sources.items())]
    return hashlib.sha256("".join(digests).encode()).hexdigest() if len(digests) > 1 else next(iter(digests), None)


def _source(reference: str, folder: Path) -> tuple[str, bytes] | None:
    """Return path and content of the module's file that ``module:Class`` names, unimported; None if there is none."""
    places, spec = None, None
    with searched(folder):
        for part in reference.partition(":")[0].split("."):
            # By its last name: that of a folder without __init__.py in another would need the outer one imported.
            spec = PathFinder.find_spec(part, places)
            if spec is None:
                return None
            places = [*spec.submodule_search_locations] if spec.submodule_search_locations else None
    file = spec.origin if spec else None
    return (file, Path(file).read_bytes()) if file and Path(file).is_file() else None


def hashes_of(loaded: Scenario) -> dict[str, str]:
    """Return the sha256 of each file that a scenario names, by its name in the scenario or relative to its folder."""
    files = sorted(dict(_named_files(loaded)).items())
    return {name: hashlib.sha256(read_bytes(file)).hexdigest() for name, file in files}


def _named_files(loaded: Scenario) -> Iterator[tuple[str, Path]]:
    folder = loaded.folder
    texts = {*texts_of(loaded.document.value), *texts_of(loaded.config.truth.model_dump(mode="json"))}
    for text in texts:
        path = os.path.expanduser(os.path.expandvars(text))
        file = next((file for file in (folder / path, Path(path)) if os.path.isfile(file)), None)
        if file is not None:
            yield text, file
    for top in {text.partition(":")[0].partition(".")[0] for text in texts if ":" in text}:
        if top.isidentifier():
            modules = [folder / f"{top}.py", *(folder / top).rglob("*.py")]
            yield from ((str(file.relative_to(folder)), file) for file in modules if file.is_file())
