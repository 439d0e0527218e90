"""A document as Markdown, with GitHub's syntax for tables."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from trackbench.document import Code, Document, with_powers, without_figures
from trackbench.document.template import environment

_SPACES = re.compile("[^\\S\N{NO-BREAK SPACE}]+")
#: Characters with a meaning in Markdown or HTML; an underscore inside a word has none.
_SPECIAL = re.compile(r"[\\`*\[\]<>|]|(?<!\w)_|_(?!\w)")


def to_markdown(document: Document, *, figures: str = "") -> str:
    """Return the text of a Markdown file.

    Args:
        document: the report.
        figures: folder of the figures' SVG files, relative to the file; empty for a text without figures.
    """
    blocks = document.blocks if figures else without_figures(document.blocks)
    text = _template().render(document=document, blocks=blocks, facts=", ".join(document.facts), folder=Markup(figures))
    return text.rstrip("\n") + "\n"


def escape_markdown(text: str) -> str:
    """Return a text in one line, with every special character of Markdown and HTML escaped."""
    return _SPECIAL.sub(r"\\\g<0>", _SPACES.sub(" ", with_powers(text)).strip())


@cache
def _template() -> Template:
    templates = environment(lambda text: Markup(escape_markdown(text)) if text.strip() else text)
    templates.globals["fenced"] = _fenced
    return templates.get_template("document.md.j2")


def _fenced(block: Code) -> Markup:
    """Return a Markdown code block whose fence is longer than any sequence of backticks in the text."""
    longest = max((len(match) for match in re.findall("`+", block.text)), default=0)
    fence = "`" * max(3, longest + 1)
    return Markup("\n".join([f"{fence}{block.language}", block.text.rstrip("\n"), fence]))
