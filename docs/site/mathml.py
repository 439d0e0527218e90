"""Equations as MathML, which a browser draws by itself: nothing is loaded to read them.

In a page they are written as GitHub reads them too: ``$`x^2`$`` within a line, and blocks of the language ``math``.
"""

from __future__ import annotations

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata
from sphinx.writers.html5 import HTML5Translator

#: What the converter does not know, or sets too close, in words that it does. The parentheses of a matrix are drawn by
#: the style sheet: few fonts have some of every height.
IN_OTHER_WORDS = {
    "{pmatrix}": "{matrix}",
    "{aligned}": "{split}",
    r"\sin": r"\,\sin",
    r"\cos": r"\,\cos",
}


def setup(app: Sphinx) -> ExtensionMetadata:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(page: HTML5Translator, node: nodes.math) -> None:
    page.body.append(mathml(node.astext().strip("`"), "inline"))
    raise nodes.SkipNode


def _block(page: HTML5Translator, node: nodes.math_block) -> None:
    page.body.append(f'<div class="equation">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


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
