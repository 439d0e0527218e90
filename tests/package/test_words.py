"""The words of the code and of the pages: no replaced name comes back, and no sentence of a page is long."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from tests.support.places import DOCS, FILES, ROOT, syntax_tree

PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]

REPLACED = {
    "About": "Linearisation",
    "Asked": "FilterCall",
    "BACK": "smoother_step",
    "Content": "SourceFingerprint",
    "Couples": "ObjectTrackPairs",
    "Doubt": "StepGuard",
    "Given": "Availability",
    "Givers": "TrackerSet",
    "Kept": "KernelCache",
    "Off": "NeesDeviation",
    "Part": "ResultModel",
    "Passage": "CallPlan",
    "Settled": "Presolved",
    "Situation": "AssociationInput",
    "Taken": "ProcessedScan",
    "WithoutCourse": "CartesianFallback",
    "aside": "reference_kind",
    "extended": "pad_state",
    "forth": "filter_step",
    "primed": "with_initial_states",
    "take_in": "linear_update",
    "untold": "scan_placeholder",
}
#: Local names that say nothing of what they hold; a set of known things is `known` by right.
VAGUE = {"asked", "found", "given", "known", "one", "said", "told"}
#: How often the code still assigns them. It may only fall.
MOST_VAGUE = 177
#: Words of a sentence; a colon and a semicolon end one too.
LONGEST_SENTENCE = 35
SENTENCE_END = re.compile(r"""(?<=[.!?:;])["')]*\s+""")
MARKDOWN = MarkdownIt("commonmark").enable("table")
#: What a piece of a paragraph counts as, by its type in Markdown: a piece of another type fails.
PIECES = {"code_inline": "code", "softbreak": " ", "hardbreak": " ", "html_inline": ""}
PIECES |= {f"{mark}_{end}": "" for mark in ("em", "strong", "link") for end in ("open", "close")}
#: What documents an object by its docstring, with its options.
DIRECTIVES_OF_SPHINX = re.compile(r"^(\.\. auto\w+::|   :[\w-]+:).*\n", re.MULTILINE)
LONG = " ".join(["word"] * LONGEST_SENTENCE) + " too many."


def definitions(tree: ast.Module) -> Iterator[str]:
    """Names of classes, functions, methods, and of what a module or a class assigns."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        if isinstance(node, ast.Module | ast.ClassDef):
            for statement in node.body:
                targets = statement.targets if isinstance(statement, ast.Assign) else []
                targets = [statement.target] if isinstance(statement, ast.AnnAssign) else targets
                yield from (target.id for target in targets if isinstance(target, ast.Name))


def test_a_definition_is_seen() -> None:
    code = "BACK = 1\nclass Given:\n    aside: int\n    def forth(self) -> None: ...\n"
    assert set(definitions(ast.parse(code))) == {"BACK", "Given", "aside", "forth"}


def test_no_replaced_name_is_defined() -> None:
    defined = [
        (file.name, name, REPLACED[name.removeprefix("_")])
        for file in FILES
        for name in definitions(syntax_tree(file))
        if name.removeprefix("_") in REPLACED
    ]
    assert not defined, "file, replaced name, name of today"


def vague_names(tree: ast.Module) -> list[int]:
    """Lines that assign a vague name."""
    return [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in VAGUE
    ]


def test_a_vague_name_is_seen() -> None:
    code = "found = 1\nfor one in found: pass\nknown: set = found\nif said := [given for given in known]: pass\n"
    assert sorted(vague_names(ast.parse(code))) == [1, 2, 3, 4, 4]


def test_vague_names_become_fewer() -> None:
    counts = Counter({str(file.relative_to(ROOT)): len(vague_names(syntax_tree(file))) for file in FILES})
    most = [f"{file} {count}" for file, count in counts.most_common() if count]
    assert counts.total() <= MOST_VAGUE, (
        f"{counts.total()} assignments to {', '.join(sorted(VAGUE))}, of {MOST_VAGUE} at most: name what the value is. "
        f"By file: {', '.join(most)}"
    )


def sentences(page: str) -> Iterator[str]:
    """Sentences of a page, with inline code as one word, without blocks of code and tables."""
    in_table = False
    for token in MARKDOWN.parse(page):
        if token.type in {"table_open", "table_close"}:
            in_table = token.type == "table_open"
        elif token.type == "html_block":
            assert token.content.strip().startswith("<!--"), "text in HTML"
            assert token.content.strip().endswith("-->"), "text in HTML"
        elif token.type == "fence":
            rest = token.content if token.info.startswith("{") else ""
            assert not DIRECTIVES_OF_SPHINX.sub("", rest), "text in a directive"
        elif token.type == "inline" and not in_table:
            text = "".join(
                piece.content if piece.type in {"text", "image", "text_special"} else PIECES[piece.type]
                for piece in token.children or ()
            )
            yield from SENTENCE_END.split(text)


def long_sentences(page: str) -> list[tuple[int, str]]:
    """``(words, sentence)`` of the sentences with too many words."""
    counts = [(len(re.findall(r"\S*\w\S*", sentence)), sentence) for sentence in sentences(page)]
    return [(words, sentence) for words, sentence in counts if words > LONGEST_SENTENCE]


@pytest.mark.parametrize(
    "page",
    [
        LONG,
        f"- Item.\n- {LONG}",
        f"1. Item:\n   - {LONG}",
        f"> {LONG}",
        f"Short. [{LONG}](page.md)",
        f"![{LONG}](image.png)",
        f"**Short.** {LONG.replace('word', '`two words`')}",
        f"<!-- comment -->\n{LONG}",
        LONG.replace(" ", "\n"),
    ],
)
def test_a_long_sentence_is_seen(page: str) -> None:
    assert [words for words, _ in long_sentences(page)] == [LONGEST_SENTENCE + 2]


@pytest.mark.parametrize(
    "page", [f"```text\n{LONG}\n```", f"| a |\n| - |\n| {LONG} |", LONG.replace("word ", "word: ")]
)
def test_code_tables_and_short_sentences_do_not_count(page: str) -> None:
    assert not long_sentences(page)


@pytest.mark.parametrize("page", [f"<p>{LONG}</p>", f"```{{note}}\n{LONG}\n```"])
def test_no_other_text_is_skipped(page: str) -> None:
    with pytest.raises(AssertionError, match="text in"):
        long_sentences(page)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_sentence_of_a_page_is_long(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not long_sentences(text), f"say it in sentences of {LONGEST_SENTENCE} words at most"
    # A block of code without an end would hide what follows.
    assert long_sentences(f"{text}\n\n{LONG}")
