"""Trackers in other languages: what ``trackbench new tracker --language`` writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

HEADERS = ("trackbench.h", "trackbench_program.h")
PYTHON = "python"


class Language(NamedTuple):
    """The files of a tracker in a language, by their templates; ``{name}`` is its name."""

    files: Mapping[str, str]
    use: str
    """How a scenario names it."""
    build: str | None = None
    """The command that builds it."""


def _built(ending: str, template: str, *headers: str) -> Language:
    shared = {name: f"languages/{name}" for name in (*headers, *HEADERS, "Makefile")}
    files = {f"{{name}}.{ending}": f"languages/{template}", "{name}.yaml": "templates/tracker.yaml.j2", **shared}
    return Language(files, "{{command: [./{name}]}}", "make {name}")


LANGUAGES: Mapping[str, Language] = {
    "cpp": _built("cpp", "tracker.cpp.j2", "trackbench.hpp"),
    "cpp-eigen": _built("cpp", "tracker_eigen.cpp.j2", "trackbench.hpp"),
    "c": _built("c", "tracker.c.j2"),
    "python-program": Language(
        {"{name}.py": "languages/tracker_program.py.j2", "{name}.yaml": "templates/tracker.yaml.j2"},
        "{{command: [python3, {name}.py]}}",
    ),
}
