"""``trackbench new``: the files of a new plug-in: a module, its test and, for trackers, a scenario."""

from __future__ import annotations

import inspect
import keyword
import sys
from collections.abc import Mapping
from importlib.metadata import packages_distributions
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import click
import jinja2

from trackbench.base.errors import InputError
from trackbench.base.plugins import attribute, import_errors_explained, searched
from trackbench.cli.answer import print_answer
from trackbench.cli.options import NearestChoice, out_option
from trackbench.metrics.registry import unfit_name

HEADERS = ("trackbench.h", "trackbench_program.h")
PYTHON = "python"


class Language(NamedTuple):
    """The files of a tracker in a language, by their templates; ``{name}`` is its name."""

    files: Mapping[str, str]
    use: str
    """How a scenario names it."""
    build: str | None = None
    """The command that builds it."""


def _built(ending: str, template: str, *headers: str, scenario: str = "tracker.yaml.j2") -> Language:
    shared = {name: f"languages/{name}" for name in (*headers, *HEADERS, "Makefile")}
    files = {f"{{name}}.{ending}": f"languages/{template}", "{name}.yaml": f"templates/{scenario}", **shared}
    return Language(files, "{{command: [./{name}]}}", "make {name}")


LANGUAGES: Mapping[str, Language] = {
    "cpp": _built("cpp", "tracker.cpp.j2", "ekf.hpp", "trackbench.hpp"),
    "cpp-eigen": _built("cpp", "tracker_eigen.cpp.j2", "trackbench.hpp"),
    "c": _built("c", "tracker.c.j2"),
    "python-program": Language(
        {"{name}.py": "languages/tracker_program.py.j2", "{name}.yaml": "templates/tracker.yaml.j2"},
        "{{command: [python3, {name}.py]}}",
    ),
}
#: Those of a tracker of several objects.
OF_SEVERAL: Mapping[str, Language] = {
    "cpp": _built("cpp", "multi_tracker.cpp.j2", "ekf.hpp", "trackbench.hpp", scenario="multi_tracker.yaml.j2"),
}

#: The files of each kind of plug-in, by their templates; ``{name}`` is the module's.
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

#: How a scenario names a new plug-in of each kind.
NAMED = {
    "tracker": "  trackers: {{mine: {{use: {use}}}}}",
    "multi-tracker": "  trackers: {{mine: {{use: {use}}}}}  # with sensing: {{identities: hidden}}",
    "motion-model": "  trackers: {{mine: {{filter: ekf, motion: {use}, ...}}}}",
    "sensor": "  sensors: {{front: {{type: {use}, rate_hz: 10, ...}}}}",
    "truth": "  truth: {{source: {use}, duration_s: 20, rate_hz: 20, ...}}",
    "metric": "  score: {{metrics: [{use}]}}",
}


def new(kind: str, name: str, out: Path, around: str | None = None, language: str = PYTHON) -> list[Path]:
    """Write the files of a new plug-in.

    Args:
        kind: one of ``KINDS``.
        name: of the module; the class is named after it, and a metric in results too.
        out: the folder, made if there is none.
        around: ``"module:Class"`` of a filter with ``predict`` and ``update`` that the tracker runs.
        language: of a tracker: ``python``, or one of ``LANGUAGES``; of several objects one of ``OF_SEVERAL``.

    Returns:
        The files, in the order of ``KINDS``.

    Raises:
        InputError: the name is no name of a module, a file with other content is there already, or the filter cannot
            be wrapped. Nothing is written then.
    """
    if not name.isidentifier() or keyword.iskeyword(name) or name != name.lower():
        raise InputError(f"{name!r} is no name for a module: write it in small letters, digits and _")
    if name in sys.stdlib_module_names or name in packages_distributions():
        raise InputError(f"{name!r} would hide an installed module of this name: use another one")
    if around is not None and kind != "tracker":
        raise InputError(f"--around goes with a tracker, not with a {kind}")
    languages = {"tracker": LANGUAGES, "multi-tracker": OF_SEVERAL}.get(kind, {})
    if language != PYTHON and (language not in languages or around is not None):
        choices = f"; it comes in {' and '.join([PYTHON, *languages])}" if languages and not around else ""
        raise InputError(f"--language {language} does not go with {'--around' if around else kind}{choices}")
    if kind == "metric" and (unfit := unfit_name(name)):
        raise InputError(f"no metric can be written: {unfit}")
    filter_ = None if around is None else wrapped_class(around)
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    patterns = {pattern: f"templates/{template}" for pattern, template in KINDS[kind].items()}
    if filter_ is not None:
        patterns["{name}.py"] = "templates/around.py.j2"
    if language != PYTHON:
        patterns = dict(languages[language].files)
    values = {"name": name, "cls": class_name(name), "use": _named(name, language), "around": filter_}
    texts = {}
    for pattern, template in patterns.items():
        text = files(__package__).joinpath(*template.split("/")).read_text(encoding="utf-8")
        text = environment.from_string(text).render(**values) if template.endswith(".j2") else text
        texts[out / pattern.format(name=name)] = text
    # Trackers in one folder share the headers.
    there = [str(path) for path, text in texts.items() if path.exists() and not _has(path, text)]
    if there:
        raise InputError(f"{' and '.join(there)} {'is' if len(there) == 1 else 'are'} there already: use another name")
    _write({path: text for path, text in texts.items() if not path.exists()})
    return list(texts)


def _has(path: Path, text: str) -> bool:
    try:
        return path.suffix in ("", ".h", ".hpp") and path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


def _named(name: str, language: str) -> str:
    """How a scenario names a new plug-in."""
    return f'"{name}:{class_name(name)}"' if language == PYTHON else LANGUAGES[language].use.format(name=name)


def class_name(name: str) -> str:
    """The class that a module is named after: ``my_tracker`` has ``MyTracker``."""
    return "".join(part.capitalize() for part in name.split("_"))


def decisions(path: Path) -> list[int]:
    """The lines of a written module that name a decision left to its author."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [number for number, line in enumerate(lines, 1) if line.lstrip().startswith("# Decide:")]


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


#: Names that a parameter for the time step, or for the noise covariance, goes by.
TIME_STEP = ("dt", "delta_t", "delta", "elapsed", "time_step", "step", "t")
NOISE = ("R", "r", "noise", "noise_covariance", "covariance", "cov")
#: What a filter needs to know, as a decision says it.
LEARNT = {
    "dt": "dt, which is not the same at every scan",
    "R": "R, the covariance of z, which is not the same for every sensor",
}
#: Values of a constructor's arguments that the generated tracker needs: a state px, py, vx, vy, measured by position.
USUAL = {"dim_x": "4", "dim_z": "2", "n": "4", "m": "2"}


class Wrapped(NamedTuple):
    """How to call a class."""

    module: str
    name: str
    arguments: dict[str, str]
    """What its constructor needs, by name, as code; "None" where the author has to decide."""
    predict: str
    """The arguments of ``predict``, as code."""
    update: str
    """The arguments of ``update``, as code."""
    decisions: dict[str, list[str]]
    """What the signatures leave open at each call: ``start``, ``predict``, ``update``."""


def wrapped_class(reference: str) -> Wrapped:
    """Look a class up and at its methods, without calling any.

    Raises:
        InputError: it cannot be imported, or has no ``predict`` and ``update``.
    """
    if ":" not in reference:
        raise InputError(f'{reference!r} is no name in a module: write --around "module:Class"')
    with searched(None), import_errors_explained(reference, None):
        cls = attribute(reference)
    methods = {name: getattr(cls, name, None) for name in ("predict", "update")}
    missing = [name for name, method in methods.items() if not callable(method)]
    if not isinstance(cls, type) or missing:
        lacking = f"it has no {' and no '.join(missing)}" if isinstance(cls, type) else "it is not a class"
        raise InputError(f"{reference!r} cannot be wrapped: {lacking}")
    constructor = _parameters(cls.__init__)  # type: ignore[misc]
    required = [item.name for item in constructor if item.default is item.empty]
    arguments = {name: USUAL.get(name, "None") for name in required}
    start = [f"what {name} is" for name, value in arguments.items() if value == "None"]
    predict, for_predict = _call(methods["predict"], dict.fromkeys(TIME_STEP, "dt"), ["dt"])
    update, for_update = _call(methods["update"], dict.fromkeys(NOISE, "R"), ["z", "R"])
    module, _, name = reference.partition(":")
    decisions = {"start": start, "predict": for_predict, "update": for_update}
    return Wrapped(module, name, arguments, predict, update, decisions)


def _call(method: Any, values: dict[str, str], usual: list[str]) -> tuple[str, list[str]]:
    """The arguments of a call, those that are required and optional ones of a usual name; what they leave open."""
    passed: list[str] = []
    decisions: list[str] = []
    for parameter in _parameters(method):
        required = parameter.default is parameter.empty
        value = values.get(parameter.name)
        if required and value is None:
            position = len(passed)
            value = usual[position] if position < len(usual) else "None"
            if value != "z":
                decisions.append(f"whether {parameter.name} of {method.__name__} is {value}")
        if value is not None and (required or parameter.name in values):
            plain = required and parameter.kind is not parameter.KEYWORD_ONLY
            passed.append(value if plain else f"{parameter.name}={value}")
    learnt = usual[-1]
    if not any(argument.rpartition("=")[2] == learnt for argument in passed):
        decisions.append(f"how {method.__name__}() learns {LEARNT[learnt]}")
    return ", ".join(passed), decisions


def _parameters(method: Any) -> list[inspect.Parameter]:
    try:
        parameters = list(inspect.signature(method).parameters.values())[1:]
    except (TypeError, ValueError):
        return []
    return [item for item in parameters if item.kind not in (item.VAR_POSITIONAL, item.VAR_KEYWORD)]


@click.command("new")
@click.argument("kind", type=NearestChoice(list(KINDS)), metavar="KIND")
@click.argument("name")
@click.option(
    "--language",
    type=NearestChoice([PYTHON, *LANGUAGES]),
    default=PYTHON,
    metavar="LANGUAGE",
    help="Of a tracker: python, cpp, cpp-eigen, c, python-program; of several objects python, cpp.  [default: python]",
)
@click.option("--around", metavar="MODULE:CLASS", help="A filter with predict and update for the tracker to run.")
@out_option("Where to.", ".")
def new_command(kind: str, name: str, language: str, around: str | None, out: Path) -> None:
    """Write a plug-in of your own that works, with its test.

    KIND is tracker (of one object), multi-tracker (of several, with hidden identities), motion-model, sensor, truth or
    metric; a tracker gets a scenario too. No file is overwritten.

    \b
    Examples:
      trackbench new tracker my_tracker
      trackbench new multi-tracker my_tracks
      trackbench new tracker my_tracker --language cpp
      trackbench new multi-tracker my_tracks --language cpp
      trackbench new tracker my_ekf --around my_filters:Ekf
    """
    paths = new(kind, name, out, around, language)
    for path in paths:
        print_answer(f"written: {path}")
    scenario = next((path for path in paths if path.suffix == ".yaml"), None)
    if language == PYTHON:
        print_answer(f"\nTest it (pip install pytest):\n  python -m pytest {paths[1]}")
    elif build := LANGUAGES[language].build:
        place = "" if out == Path() else f" -C {out}"
        print_answer(f"\nBuild it:\n  {build.format(name=name)}{place}")
    if scenario is not None:
        print_answer(f"Run it:\n  trackbench run {scenario}")
    if language != PYTHON:
        print_answer(f"Find its faults:\n  trackbench doctor {scenario}#mine")
    use = _named(name, language)
    print_answer(f"Name it in a scenario beside {paths[0].name}:\n{NAMED[kind].format(use=use)}")
    lines = decisions(paths[0])
    if lines:
        word = "1 decision: line" if len(lines) == 1 else f"{len(lines)} decisions: lines"
        print_answer(f"{paths[0]} leaves you {word} {', '.join(map(str, lines))}")
