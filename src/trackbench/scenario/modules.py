"""The modules of the user's own that a scenario names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trackbench.scenario.load import Scenario


def own_modules(loaded: Scenario) -> list[Path]:
    """The modules beside a scenario that it names, as in ``use: my_tracker:Tracker``."""
    folder = loaded.path.resolve().parent
    files = (folder / f"{name}.py" for name in _named(loaded) if name.isidentifier())
    return list(dict.fromkeys(file for file in files if file.is_file()))


def own_folder(loaded: Scenario) -> Path | None:
    """The scenario's folder, if there are modules or packages in it that the scenario names."""
    folder = loaded.path.resolve().parent
    tops = {name.partition(".")[0] for name in _named(loaded)}
    there = any((folder / f"{top}.py").is_file() or (folder / top / "__init__.py").is_file() for top in tops)
    return folder if there else None


def _named(loaded: Scenario) -> Iterator[str]:
    """What stands before the colon in every text of the scenario that has one."""
    waiting: list[Any] = [loaded.document.value]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict | list):
            waiting += node.values() if isinstance(node, dict) else node
        elif isinstance(node, str) and ":" in node:
            yield node.partition(":")[0]
