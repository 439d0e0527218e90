"""The documentation as a site, made by Sphinx: `make docs`. Each page is a Markdown file beside this one."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.napoleon import GoogleDocstring

sys.path.insert(0, str(Path(__file__).parent / "site"))

project = "trackbench"
extensions = ["excerpts", "mathml", "myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["site"]

# Markdown as GitHub reads it.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}
autodoc_type_aliases = {"Array": "Array", "Mask": "Mask", "Indices": "Indices"}
autodoc_class_signature = "separated"

html_theme = "furo"
html_title = "trackbench"
html_math_renderer = "mathml"
html_static_path = ["site/static"]
html_css_files = ["trackbench.css"]
html_copy_source = False
html_use_index = False
html_show_copyright = False


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _add_menu)
    app.connect("autodoc-process-docstring", _read_sections)


def _add_menu(_app: Sphinx, page: str, source: list[str]) -> None:
    """Make the menu beside each page of the headings and links of the first page."""
    if page == "index":
        sections = re.split(r"^## (.*)$", source[0], flags=re.MULTILINE)
        for heading, text in zip(sections[1::2], sections[2::2], strict=True):
            listed = "\n".join(re.findall(r"\]\(([\w/-]+)\.md\)", text))
            if listed:
                source[0] += f"\n\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{listed}\n```\n"


def _read_sections(_app: Sphinx, what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Args, Returns and Raises of a docstring become lists; that of an attribute is text, colons and all."""
    if what != "attribute":
        lines[:] = GoogleDocstring(lines).lines()
