"""A page of HTML that loads nothing from anywhere: styles and figures are in the file."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def page(template: str, **values: object) -> str:
    """The text of a page made from one of the templates beside this file."""
    environment = Environment(
        loader=PackageLoader("trackbench.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made: Any = environment.get_template(template).render(**values)
    return str(made)
