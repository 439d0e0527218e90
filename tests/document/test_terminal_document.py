"""A document on a terminal: the answer is its first line, and a table that does not fit says nothing twice."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from trackbench.document import Block, Cell, Column, Document, Item, Items, Paragraph, Section, Status, Table
from trackbench.document.terminal import print_document, print_table


def printed(*blocks: Block, lead: str = "") -> list[str]:
    output = io.StringIO()
    print_document(Document("kind", "Kind: name", blocks, lead), Console(file=output, width=80))
    return output.getvalue().splitlines()


@pytest.mark.parametrize(
    ("block", "lead", "first"),
    [
        (Status("1 of 2 limits failed", "bad"), "Of these.", ["Kind of name: 1 of 2 limits failed", "Of these."]),
        (Paragraph("a is best.", strong=True), "", ["a is best.", "Kind: name"]),
        (Items((Item("holds in all", "a"), Item("fails", "b"))), "", ["- a: holds in all", "- b: fails", "Kind: name"]),
        (Section("Part", (Paragraph("text"),)), "Nothing changed.", ["Kind of name: Nothing changed.", "", "Part"]),
        (Paragraph("text"), "", ["Kind: name", "text"]),
    ],
)
def test_the_answer_comes_first_and_once(block: Block, lead: str, first: list[str]) -> None:
    lines = printed(block, Paragraph("after"), lead=lead)
    assert lines[: len(first)] == first
    assert sum("after" in line for line in lines) == 1
    assert len(set(filter(None, lines))) == len([*filter(None, lines)])


def test_a_table_whose_keys_fill_the_screen_is_a_list() -> None:
    columns = (Column("tracker", left=True), Column("fails at", left=True), Column("distance"), Column("value"))
    place = "speed 10 m/s, deceleration 2 m/s², latency 0.3 s"
    row = (Cell("ekf", tracker="ekf"), Cell(place), Cell("0.96"), Cell("x" * 30))
    output = io.StringIO()
    print_table(Table("t", columns, (row,)), Console(file=output, width=80))
    lines = output.getvalue().splitlines()
    assert lines[0].startswith(f"- ekf: fails at {place}; distance")
    assert all(len(line) <= 80 for line in lines)
    assert output.getvalue().count("speed 10 m/s") == 1
