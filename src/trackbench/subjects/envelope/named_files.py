"""The files beside a scenario that it names: modules, programs and logs, without which it cannot be replayed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError
from trackbench.base.files import read_bytes
from trackbench.scenario import Scenario


def hashes_of(loaded: Scenario) -> dict[str, str]:
    """By name, as the scenario has it or relative to its folder, the sha256 of each file."""
    files = sorted(dict(_named(loaded)).items())
    return {name: hashlib.sha256(read_bytes(file)).hexdigest() for name, file in files}


def require_same(loaded: Scenario, hashes: Mapping[str, str]) -> None:
    """Make sure that the files are those of which the hashes are.

    Raises:
        InputError: one is missing or another.
    """
    here = hashes_of(loaded)
    for name, digest in hashes.items():
        if name not in here:
            message = f"{name}, which the scenario names, is not there: say by --beside in which folder it is"
            raise InputError(message, file=loaded.path)
        if here[name] != digest:
            message = f"{name} is not the one of the claim: its sha256 is {here[name][:12]}..., not {digest[:12]}..."
            raise InputError(message, file=loaded.path)


def _named(loaded: Scenario) -> Iterator[tuple[str, Path]]:
    folder = loaded.path.resolve().parent
    texts = {*_texts(loaded.document.value), *_texts(loaded.config.truth.model_dump(mode="json"))}
    for text in texts:
        path = os.path.expanduser(os.path.expandvars(text))
        file = next((file for file in (folder / path, Path(path)) if os.path.isfile(file)), None)
        if file is not None:
            yield text, file
    for top in {text.partition(":")[0].partition(".")[0] for text in texts if ":" in text}:
        if top.isidentifier():
            modules = [folder / f"{top}.py", *(folder / top).rglob("*.py")]
            yield from ((str(file.relative_to(folder)), file) for file in modules if file.is_file())


def _texts(node: Any) -> Iterator[str]:
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict | list):
            waiting += node.values() if isinstance(node, dict) else node
        elif isinstance(node, str):
            yield node
