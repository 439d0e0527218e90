"""The documentation is short enough to be kept true: words of its prose, and of a sentence where a reader begins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.places import DOCS, ROOT

#: Words of all pages that people write, with their tables and without code.
MOST_WORDS = 40_000
#: Words of a sentence.
LONGEST = 30
FIRST_PAGES = [ROOT / "README.md", DOCS / "index.md", *sorted((DOCS / "start").glob("*.md"))]

FENCE = re.compile(r"^( *)(`{3,})[^\n]*\n.*?^\1\2$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)")
BLOCK = re.compile(r"\n\s*\n|\n\s*(?:[-*]|\d+\.) |^#+ .*$|^\|.*$", re.MULTILINE)
END = re.compile(r"(?<=[.!?])[)*\"]*\s+(?=[\w`*(\[/\"])|:\n")


def prose(text: str) -> str:
    """Without code, comments, equations and the targets of links."""
    for pattern, instead in ((FENCE, ""), (re.compile(r"<!--.*?-->", re.DOTALL), ""), (LINK, r"\1")):
        text = pattern.sub(instead, text)
    return re.sub(r"\$`.*?`\$", "x", text, flags=re.DOTALL)


def words(text: str) -> int:
    return len(re.findall(r"\w\S*", text))


def sentences(text: str) -> Iterator[str]:
    """Of paragraphs and items, without headings and tables."""
    for block in BLOCK.split(prose(text)):
        yield from END.split(" ".join(block.split()))


PAGE = """# A heading

One [two](three.md) `four`.
Five six: $`seven`$.

- eight
- nine <!-- ten -->

```sh
eleven
```

| twelve | thirteen |
"""


def test_words_and_sentences_are_counted() -> None:
    assert words(prose(PAGE)) == 12
    assert [words(sentence) for sentence in sentences(PAGE) if words(sentence)] == [3, 3, 1, 1]


def test_the_documentation_is_short() -> None:
    pages = {page: page.read_text(encoding="utf-8") for page in sorted(DOCS.rglob("*.md"))}
    count = {
        page.relative_to(DOCS).as_posix(): words(prose(text))
        for page, text in pages.items()
        if "<!-- Made " not in text
    }
    assert sum(count.values()) <= MOST_WORDS, sorted(count.items(), key=lambda item: -item[1])


@pytest.mark.parametrize("page", FIRST_PAGES, ids=lambda page: page.stem)
def test_sentences_are_short_where_a_reader_begins(page: Path) -> None:
    long = [sentence for sentence in sentences(page.read_text(encoding="utf-8")) if words(sentence) > LONGEST]
    assert not long, "\n".join(long)
