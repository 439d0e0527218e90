"""A document as data: what a report says, free of any markup. Each renderer writes the same document in its format."""

from trackbench.document.model import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Item,
    Items,
    LegendEntry,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    Tone,
    TrackerStyle,
)

__all__ = [
    "Block",
    "Cell",
    "Code",
    "Column",
    "Document",
    "Figure",
    "Item",
    "Items",
    "LegendEntry",
    "Paragraph",
    "Row",
    "Section",
    "Status",
    "Table",
    "Tone",
    "TrackerStyle",
]
