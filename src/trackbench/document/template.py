"""The jinja2 templates of the pages: HTML and Markdown say the same document."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

from jinja2 import Environment, PackageLoader, StrictUndefined

from trackbench.document import Block


def environment(escape: Callable[[str], str]) -> Environment:
    """Return an environment that escapes every text that is put in; markup is kept.

    Args:
        escape: makes a text of the document one of the format; HTML's own characters are escaped after it, unless it
            returns markup.
    """
    made = Environment(
        loader=PackageLoader("trackbench.document"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: escape(value) if type(value) is str else value,
    )
    tests: Any = made.tests
    for kind in get_args(Block):
        tests[kind.__name__.lower()] = lambda block, kind=kind: isinstance(block, kind)
    return made
