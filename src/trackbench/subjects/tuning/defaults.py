"""The source of a tracker of one's own, and the defaults that it states."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any


def stated_default(use: str, option: str, folder: Path) -> Any:
    """The default of an argument of a tracker's class, or of a function that makes it; None where it is not known.

    The source is read and not run: such a tracker is imported in its own process alone.

    Args:
        use: ``"module:Class"``; the default of a published name is not known.
        option: the argument.
        folder: where the module is looked for, before the working directory.
    """
    file = source_of(use, folder)
    if file is None:
        return None
    try:
        made = _named(use.partition(":")[2], ast.parse(file.read_bytes()).body)
        found = _named("__init__", made.body) if isinstance(made, ast.ClassDef) else made
        defaults = dict(_defaults(found.args)) if isinstance(found, ast.FunctionDef) else {}
        return ast.literal_eval(defaults[option]) if option in defaults else None
    except (SyntaxError, ValueError):
        return None


def source_of(use: str, folder: Path) -> Path | None:
    """The file of the module of ``"module:Class"`` in a folder or the working directory; None where there is none."""
    module, _, name = use.partition(":")
    files = (place.joinpath(*module.split(".")).with_suffix(".py") for place in (folder, Path.cwd()))
    return next((file for file in files if name and file.is_file()), None)


def _named(name: str, body: Sequence[ast.stmt]) -> ast.stmt | None:
    return next((item for item in body if isinstance(item, ast.ClassDef | ast.FunctionDef) and item.name == name), None)


def _defaults(arguments: ast.arguments) -> Iterator[tuple[str, ast.expr]]:
    positional = [*arguments.posonlyargs, *arguments.args]
    for argument, default in zip(reversed(positional), reversed(arguments.defaults), strict=False):
        yield argument.arg, default
    for argument, given in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        if given is not None:
            yield argument.arg, given
