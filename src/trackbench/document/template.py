"""Jinja2 environment with the templates of the text formats: HTML, Markdown and JUnit XML."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

from jinja2 import Environment, PackageLoader, StrictUndefined

from trackbench.document import Block


def environment(escape: Callable[[str], str]) -> Environment:
    """Return a Jinja2 environment for a text format, which escapes every inserted text but no markup.

    Args:
        escape: function that escapes a text of the document for the format; if it does not return markup, HTML's
            special characters are escaped too.
    """
    templates = Environment(
        loader=PackageLoader("trackbench.document"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: escape(value) if type(value) is str else value,
    )
    tests: Any = templates.tests
    for kind in get_args(Block):
        tests[kind.__name__.lower()] = lambda block, kind=kind: isinstance(block, kind)
    return templates
