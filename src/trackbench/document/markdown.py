"""A document as Markdown, with the tables of GitHub."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from trackbench.document import Code, Document, with_powers, without_figures
from trackbench.document.template import environment

_SPACES = re.compile("[^\\S\N{NO-BREAK SPACE}]+")
#: What Markdown or HTML could take for its own; an underscore inside a word is safe.
_SPECIAL = re.compile(r"[\\`*\[\]<>|]|(?<!\w)_|_(?!\w)")


def to_markdown(document: Document, *, figures: str = "") -> str:
    """The text of a Markdown file.

    Args:
        document: what it says.
        figures: the folder of the figures' SVG files, relative to the file; without one it has no figures.
    """
    blocks = document.blocks if figures else without_figures(document.blocks)
    text = _template().render(document=document, blocks=blocks, facts=", ".join(document.facts), folder=Markup(figures))
    return text.rstrip("\n") + "\n"


def escape_markdown(text: str) -> str:
    """``text`` as it is, in one line, whatever Markdown or HTML it looks like."""
    return _SPECIAL.sub(r"\\\g<0>", _SPACES.sub(" ", with_powers(text)).strip())


@cache
def _template() -> Template:
    made = environment(lambda text: Markup(escape_markdown(text)) if text.strip() else text)
    made.globals["fenced"] = _fenced
    return made.get_template("document.md.j2")


def _fenced(block: Code) -> Markup:
    """In a fence that is longer than any in it."""
    longest = max((len(match) for match in re.findall("`+", block.text)), default=0)
    fence = "`" * max(3, longest + 1)
    return Markup("\n".join([f"{fence}{block.language}", block.text.rstrip("\n"), fence]))
