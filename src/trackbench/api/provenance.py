"""When and of which code a result is made: time, git commit of the scenario, sha256 of the code of own trackers."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from trackbench.base.plugins import searched
from trackbench.results.provenance import Provenance
from trackbench.scenario import Scenario
from trackbench.scenario.shipped import is_shipped
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.published import TRACKERS

#: How long git may take, s.
PATIENCE = 20.0


def provenance_of(loaded: Scenario) -> Provenance:
    """What there is to say of a scenario that is about to run."""
    made_at = datetime.now(UTC).isoformat(timespec="milliseconds")
    commit, changed, reason = _commit(loaded.path.resolve())
    code = _code_of_trackers(loaded)
    return Provenance(made_at=made_at, commit=commit, changed=changed, no_commit=reason, code=code)


class _GitError(Exception):
    """Git does not answer; the text says why."""


def _commit(scenario: Path) -> tuple[str | None, bool | None, str]:
    """The commit that holds a scenario, whether the repository differs from it, and why there is none."""
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
    """What git prints in a folder.

    Raises:
        _GitError: it is not installed, or it fails.
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


#: How a module and what is in it are named.
_REFERENCE = re.compile(r"([^\W\d][\w.]*):[^\W\d][\w.]*")


def _code_of_trackers(loaded: Scenario) -> dict[str, str | None]:
    """By name of each tracker with code that is not part of trackbench, the sha256 of that code."""
    folder, code = loaded.path.resolve().parent, {}
    for name, tracker in loaded.config.trackers.items():
        modules = {*_modules(loaded.document.value["trackers"][name])}
        own = isinstance(tracker, PluginConfig) and not TRACKERS.home_of(tracker.reference).startswith("trackbench.")
        if isinstance(tracker, PluginConfig) and own:
            modules.add(TRACKERS.home_of(tracker.reference))
        files = {file for module in modules if (file := _source(module, folder))}
        if isinstance(tracker, PluginConfig) and isinstance(tracker.use, Command):
            files |= tracker.use.files(folder)
        if own or files:
            code[name] = _sha256(files)
    return code


def _modules(stated: Any) -> Iterator[str]:
    """Those that the texts of a tracker's entry name, but for trackbench's own."""
    waiting = [stated]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict | list):
            waiting += node.values() if isinstance(node, dict) else node
        elif isinstance(node, str) and (match := _REFERENCE.fullmatch(node)) and not node.startswith("trackbench."):
            yield match[1]


def _sha256(files: Iterable[Path]) -> str | None:
    """Of a file; of several, that of their sha256 one after the other; None of none."""
    digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(files)]
    return hashlib.sha256("".join(digests).encode()).hexdigest() if len(digests) > 1 else next(iter(digests), None)


def _source(module: str, folder: Path) -> Path | None:
    """The file of a module, which is not imported."""
    places, name, spec = None, "", None
    with searched(folder):
        for part in module.split("."):
            name = f"{name}.{part}" if name else part
            spec = PathFinder.find_spec(name, places)
            if spec is None:
                return None
            places = spec.submodule_search_locations
    return Path(spec.origin) if spec and spec.origin and Path(spec.origin).is_file() else None
