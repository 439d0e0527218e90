"""Equations as MathML, which a browser draws by itself: nothing is loaded to read them.

They are written as GitHub reads them too: ``$`x^2`$`` within a line, and blocks of the language ``math``.
"""

from __future__ import annotations

import re
from typing import Any

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor
from markdown.preprocessors import Preprocessor

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INLINE = r"\$`([^`]+)`\$"
#: What the converter does not know, or sets too close, in words that it does. The parentheses of a matrix are drawn by
#: the style sheet: few fonts have some of every height.
IN_OTHER_WORDS = {
    "{pmatrix}": "{matrix}",
    "{aligned}": "{split}",
    r"\sin": r"\,\sin",
    r"\cos": r"\,\cos",
}


def on_config(config: Any) -> Any:
    """Called by MkDocs."""
    config.markdown_extensions.append(Equations())
    return config


class Equations(Extension):
    """The Markdown extension."""

    def extendMarkdown(self, md: Markdown) -> None:
        # Before fenced code (25), and before code within a line (190), which would take them for its own.
        md.preprocessors.register(_Blocks(md), "equation blocks", 26)
        md.inlinePatterns.register(_Inline(INLINE, md), "equations", 191)


class _Blocks(Preprocessor):
    def run(self, lines: list[str]) -> list[str]:
        return BLOCK.sub(self._stored, "\n".join(lines)).split("\n")

    def _stored(self, found: re.Match[str]) -> str:
        html = f'<div class="equation">{mathml(found[1], "block")}</div>'
        return f"\n{self.md.htmlStash.store(html)}\n"


class _Inline(InlineProcessor):
    def handleMatch(self, m: re.Match[str], data: str) -> tuple[str, int, int]:
        return self.md.htmlStash.store(mathml(m[1], "inline")), m.start(0), m.end(0)


def mathml(tex: str, display: str) -> str:
    """The equation.

    Raises:
        ValueError: it has a command that is not understood.
    """
    words = " ".join(tex.split())
    for known, other in IN_OTHER_WORDS.items():
        words = words.replace(known, other)
    found = convert(words, display=display)
    if "\\" in found or "<mi>&</mi>" in found:
        raise ValueError(f"not understood: {tex}")
    return found
