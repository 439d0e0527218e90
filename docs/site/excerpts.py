"""Excerpts of the pages that a search finds, from a disk too: a browser lets such a page run scripts, not fetch pages.

So the texts of all pages become a script, `texts.js`, which `excerpts.js` gives to Sphinx's search.
"""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata


def setup(app: Sphinx) -> ExtensionMetadata:
    """Called by Sphinx."""
    app.connect("html-page-context", _add_scripts)
    app.connect("build-finished", _write_texts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _add_scripts(app: Sphinx, page: str, *_: Any) -> None:
    if page == "search":
        for script in ("texts.js", "excerpts.js"):
            # After Sphinx's own scripts, and before they search.
            app.add_js_file(script, loading_method="defer")


def _write_texts(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        texts = {f"./{page}.html": _text(app.env.get_doctree(page)) for page in sorted(app.env.found_docs)}
        file = Path(app.outdir, "_static", "texts.js")
        file.write_text(f"const TEXTS = {json.dumps(texts, ensure_ascii=False)};\n", encoding="utf-8")


def _text(node: nodes.Node) -> str:
    """The text of a node as HTML that has its anchors, and no other tags."""
    if isinstance(node, nodes.Text):
        return escape(node.astext())
    if isinstance(node, nodes.Invisible):
        return ""
    text = "".join(map(_text, node.children))
    if not isinstance(node, nodes.Inline):
        text += " "
    for name in getattr(node, "attributes", {}).get("ids", ()):
        text = f'<div id="{escape(name)}">{text}</div>'
    return text
