"""The command ``trackbench new``, which writes the files of a new plug-in from templates."""

from __future__ import annotations

import keyword
import sys
from collections.abc import Mapping
from importlib.metadata import packages_distributions
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import click
import jinja2

from trackbench.base.errors import InputError
from trackbench.cli.answer import print_answer
from trackbench.cli.options import NearestChoice, out_option
from trackbench.metrics.registry import unfit_name

HEADERS = ("trackbench.h", "trackbench_program.h")
PYTHON = "python"


class Language(NamedTuple):
    """Template of a tracker in one programming language: its files, its scenario value, and its build command."""

    files: Mapping[str, str]
    """Template of each file, by file name; ``{name}`` stands for the tracker's name."""
    use: str
    """Value of the scenario key ``use``, which names the tracker's program or class."""
    build: str | None = None
    """Command that builds the program; None for a script."""


def _compiled(ending: str, template: str, *headers: str, scenario: str = "tracker.yaml.j2") -> Language:
    shared = {name: f"languages/{name}" for name in (*headers, *HEADERS, "Makefile")}
    files = {f"{{name}}.{ending}": f"languages/{template}", "{name}.yaml": f"templates/{scenario}", **shared}
    return Language(files, "{{command: [./{name}]}}", "make {name}")


LANGUAGES: Mapping[str, Language] = {
    "cpp": _compiled("cpp", "tracker.cpp.j2", "ekf.hpp", "trackbench.hpp"),
    "c": _compiled("c", "tracker.c.j2"),
    "python-program": Language(
        {"{name}.py": "languages/tracker_program.py.j2", "{name}.yaml": "templates/tracker.yaml.j2"},
        "{{command: [python3, {name}.py]}}",
    ),
}
#: Languages of a tracker of several objects.
OF_SEVERAL: Mapping[str, Language] = {
    "cpp": _compiled("cpp", "multi_tracker.cpp.j2", "ekf.hpp", "trackbench.hpp", scenario="multi_tracker.yaml.j2"),
}

#: Templates of each kind of plug-in, by file name; ``{name}`` stands for the module's name.
KINDS: Mapping[str, Mapping[str, str]] = {
    "tracker": {"{name}.py": "tracker.py.j2", "test_{name}.py": "test_tracker.py.j2", "{name}.yaml": "tracker.yaml.j2"},
    "multi-tracker": {
        "{name}.py": "multi_tracker.py.j2",
        "test_{name}.py": "test_multi_tracker.py.j2",
        "{name}.yaml": "multi_tracker.yaml.j2",
    },
    "motion-model": {"{name}.py": "motion_model.py.j2", "test_{name}.py": "test_motion_model.py.j2"},
    "sensor": {"{name}.py": "sensor.py.j2", "test_{name}.py": "test_sensor.py.j2"},
    "truth": {"{name}.py": "truth.py.j2", "test_{name}.py": "test_truth.py.j2"},
    "metric": {"{name}.py": "metric.py.j2", "test_{name}.py": "test_metric.py.j2"},
}

#: Lines of a scenario that use a new plug-in, by kind.
USES = {
    "tracker": "  trackers: {{mine: {{use: {use}}}}}",
    "multi-tracker": "  trackers: {{mine: {{use: {use}}}}}  # with sensing: {{identities: hidden}}",
    "motion-model": "  trackers: {{mine: {{filter: ekf, motion: {use}, ...}}}}",
    "sensor": "  sensors: {{front: {{type: {use}, rate_hz: 10, ...}}}}",
    "truth": "  truth: {{source: {use}, duration_s: 20, rate_hz: 20, ...}}",
    "metric": "  score: {{metrics: [{use}]}}",
}


def new(kind: str, name: str, out: Path, language: str = PYTHON) -> list[Path]:
    """Write the files of a new plug-in; return their paths in the order of ``KINDS``.

    Args:
        kind: one of ``KINDS``.
        name: name of the module, after which the class, and a metric in results, are named.
        out: folder of the files, which is made if needed.
        language: language of a tracker: ``python``, or one of ``LANGUAGES`` (``OF_SEVERAL`` for several objects).

    Raises:
        InputError: the name is invalid for a module, or a file with other content exists; nothing is written.
    """
    if not name.isidentifier() or keyword.iskeyword(name) or name != name.lower():
        raise InputError(f"{name!r} is no name for a module: write it in small letters, digits and _")
    if name in sys.stdlib_module_names or name in packages_distributions():
        raise InputError(f"{name!r} would hide an installed module of this name: use another one")
    languages = {"tracker": LANGUAGES, "multi-tracker": OF_SEVERAL}.get(kind, {})
    if language != PYTHON and language not in languages:
        choices = f"; it comes in {' and '.join([PYTHON, *languages])}" if languages else ""
        raise InputError(f"--language {language} does not go with {kind}{choices}")
    if kind == "metric" and (unfit := unfit_name(name)):
        raise InputError(f"no metric can be written: {unfit}")
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    patterns = {pattern: f"templates/{template}" for pattern, template in KINDS[kind].items()}
    if language != PYTHON:
        patterns = dict(languages[language].files)
    values = {"name": name, "cls": class_name(name), "use": _use_of(name, language)}
    texts = {}
    for pattern, template in patterns.items():
        text = files(__package__).joinpath(*template.split("/")).read_text(encoding="utf-8")
        text = environment.from_string(text).render(**values) if template.endswith(".j2") else text
        texts[out / pattern.format(name=name)] = text
    # Existing files with equal content are accepted, since trackers in one folder share headers.
    taken = [str(path) for path, text in texts.items() if path.exists() and not _has_content(path, text)]
    if taken:
        raise InputError(f"{' and '.join(taken)} {'is' if len(taken) == 1 else 'are'} there already: use another name")
    _write({path: text for path, text in texts.items() if not path.exists()})
    return list(texts)


def _has_content(path: Path, text: str) -> bool:
    try:
        return path.suffix in ("", ".h", ".hpp") and path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


def _use_of(name: str, language: str) -> str:
    return f'"{name}:{class_name(name)}"' if language == PYTHON else LANGUAGES[language].use.format(name=name)


def class_name(name: str) -> str:
    """Return the name of a module's class: ``MyTracker`` for ``my_tracker``."""
    return "".join(part.capitalize() for part in name.split("_"))


def _write(texts: Mapping[Path, str]) -> None:
    written: list[Path] = []
    try:
        for path, text in texts.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as stream:
                written.append(path)
                stream.write(text)
    except OSError as error:
        for path in written:
            path.unlink(missing_ok=True)
        raise InputError(f"{path} cannot be written: {error.strerror}") from None


@click.command("new")
@click.argument("kind", type=NearestChoice(list(KINDS)), metavar="KIND")
@click.argument("name")
@click.option(
    "--language",
    type=NearestChoice([PYTHON, *LANGUAGES]),
    default=PYTHON,
    metavar="LANGUAGE",
    help="Language of a tracker: python, cpp, c, python-program; multi-tracker: python, cpp.  [default: python]",
)
@out_option("Folder of the files.", ".")
def new_command(kind: str, name: str, language: str, out: Path) -> None:
    """Write a plug-in of your own that works, with its test.

    KIND is tracker (of one object), multi-tracker (of several, with hidden identities), motion-model, sensor, truth or
    metric; a tracker gets a scenario too. No file is overwritten.

    \b
    Examples:
      trackbench new tracker my_tracker
      trackbench new multi-tracker my_tracks
      trackbench new tracker my_tracker --language cpp
      trackbench new multi-tracker my_tracks --language cpp
    """
    paths = new(kind, name, out, language)
    for path in paths:
        print_answer(f"written: {path}")
    scenario = next((path for path in paths if path.suffix == ".yaml"), None)
    if language == PYTHON:
        print_answer(f"\nTest it (pip install pytest):\n  python -m pytest {paths[1]}")
    elif build := LANGUAGES[language].build:
        folder = "" if out == Path() else f" -C {out}"
        print_answer(f"\nBuild it:\n  {build.format(name=name)}{folder}")
    if scenario is not None:
        print_answer(f"Run it:\n  trackbench run {scenario}")
    if language != PYTHON:
        print_answer(f"Find its faults:\n  trackbench doctor {scenario}#mine")
    use = _use_of(name, language)
    print_answer(f"Name it in a scenario beside {paths[0].name}:\n{USES[kind].format(use=use)}")
