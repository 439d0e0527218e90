"""Damage of every kind, drawn from a seed."""

from __future__ import annotations

import copy
import io
import json
import os
import random
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

#: What a value is replaced by.
EXTREMES: tuple[Any, ...] = (
    None, True, False, 0, -0.0, -1, 1, 7, 0.5, 1e-320, 1e-9, 1e9, 1e30, -1e30, 1e154, 1e308, -1e308, 2**31, 2**63,
    10**30, 10**400, float("nan"), float("inf"), -float("inf"), "", " ", "x", "0", "1e999", "20 m", "5%", "nan", "é",
    "a\x01b", "\x00", "\u2028", "\ufeff", "$x^$", "[red]", "<b>&", "../..", "/dev/zero", "a" * 300, "cv", "ekf", "ego",
    "all", "truth", "radar", "lidar", "a" * 5000, [], {},
    [1, 2], [[]], [None], {"a": 1}, {"": {}}, {"type": "radar"}, [1e308] * 4,
)  # fmt: skip
#: Pieces of YAML, JSON, CSV and of nothing.
SNIPPETS = (
    "a: &a [*a]\n", "<<: *x\n", "? [1]\n: 2\n", "!!python/object:os.system x\n", "---\n", "- \n", ": ", "{", "}", "[",
    "]",
    '"', "'", "\t", "\x00", "\x1b[31m", "\r", "\n", ",", "&x ", "*x", "|\n", "#", "%", "é", "\u2028", "<<", "- [" * 40,
    "a: &m {}\nb: &m {<<: [*m, *m, *m]}\n", "x: [" + "0, " * 200_000 + "]\n",
    "[" * 3000, "{a: " * 500, "1e308", "-1e308", ".nan", "NaN", "Infinity", "9" * 400, "null", "~", "\ufeff",
)  # fmt: skip


def count(default: int) -> int:
    """How many cases are tried: ``TRACKBENCH_FUZZ`` of them, or a few."""
    return int(os.environ.get("TRACKBENCH_FUZZ", default))


def cases(default: int) -> range:
    """The seeds of the cases; ``TRACKBENCH_FUZZ_FROM`` is the first, to go on or to see one again."""
    first = int(os.environ.get("TRACKBENCH_FUZZ_FROM", 0))
    return range(first, first + count(default))


def edited_bytes(chance: random.Random, raw: bytes, other: bytes = b"") -> bytes:
    """Bytes flipped, cut out, doubled or put in, the end cut off, or the rest of another file joined on."""
    data = bytearray(raw)
    match chance.randrange(6):
        case 0:
            for _ in range(chance.choice([1, 1, 2, 20])):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case 1:
            del data[chance.randrange(len(data)) :]
        case 2:
            start = chance.randrange(len(data))
            del data[start : start + chance.choice([1, 4, 100])]
        case 3:
            start = chance.randrange(len(data))
            data[start:start] = data[start : start + chance.choice([1, 16, 1000])]
        case 4:
            start = chance.randrange(len(data))
            data[start : start + chance.choice([0, 4])] = chance.randbytes(chance.choice([1, 4, 64]))
        case _:
            data = data[: chance.randrange(len(data))] + (other or raw)[chance.randrange(len(other or raw)) :]
    return bytes(data)


def edited_text(chance: random.Random, text: str) -> str:
    """Snippets put in, lines doubled, dropped and swapped."""
    for _ in range(chance.randint(1, 3)):
        lines = text.splitlines(keepends=True) or [""]
        at = chance.randrange(len(lines))
        match chance.randrange(5):
            case 0:
                lines.insert(at, lines[chance.randrange(len(lines))])
            case 1:
                del lines[at]
            case 2:
                other = chance.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
            case 3:
                lines.insert(at, chance.choice(SNIPPETS))
            case _:
                where = chance.randrange(len(lines[at]) + 1)
                rest = where + chance.choice([0, 0, 1, 5])
                lines[at] = lines[at][:where] + chance.choice(SNIPPETS) + lines[at][rest:]
        text = "".join(lines)
    return text


def edited_tree(chance: random.Random, tree: Any) -> Any:
    """Values replaced by extremes or by other parts of the tree, keys removed, renamed and added."""
    tree = copy.deepcopy(tree)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        nodes = containers_of(tree)
        if not nodes:
            return chance.choice(EXTREMES)
        node = chance.choice(nodes)
        value = copy.deepcopy(chance.choice(EXTREMES) if chance.random() < 0.8 else chance.choice(nodes))
        if isinstance(node, list):
            match chance.randrange(3) if node else 0:
                case 0:
                    node.insert(chance.randint(0, len(node)), value)
                case 1:
                    del node[chance.randrange(len(node))]
                case _:
                    node[chance.randrange(len(node))] = value
            continue
        keys = list(node)
        match chance.randrange(5) if keys else 0:
            case 0:
                node[chance.choice(["", "x", "type", "use", "a b", *_keys(tree)])] = value
            case 1:
                del node[chance.choice(keys)]
            case 2:
                key = chance.choice(keys)
                node[chance.choice([key + "s", key[:-1], key.upper(), "\x01", *_keys(tree)])] = node.pop(key)
            case _:
                node[chance.choice(keys)] = value
    return tree


def edited_table(chance: random.Random, table: pa.Table) -> pa.Table:
    """Rows lost, doubled or in another order; a column dropped, renamed, of another type or with other values."""
    random_rows = np.random.default_rng(chance.randrange(2**32))
    rows = len(table)
    match chance.randrange(9):
        case 0:
            return table.slice(chance.randrange(rows + 1))
        case 1:
            return table.take(random_rows.permutation(rows))
        case 2:
            return table.take(random_rows.integers(rows, size=rows)) if rows else table
        case 3:
            return table.drop_columns([chance.choice(table.column_names)]) if table.num_columns else table
    if not table.num_columns:
        return table
    column = chance.randrange(table.num_columns)
    name, values = table.column_names[column], table.column(column).to_pylist()
    kind = chance.randrange(5)
    if kind == 0:
        return table.rename_columns(
            [chance.choice(["", "x", "time_s", other]) if other == name else other for other in table.column_names]
        )
    made = pa.array(values)
    if kind == 1:
        made = chance.choice([
            pa.nulls(rows), pa.array([str(value) for value in values]), pa.array([[1]] * rows),
            pa.array([b"\xff"] * rows), pa.array([{"a": 1}] * rows), pa.array([True] * rows), pa.array([2**62] * rows),
        ])  # fmt: skip
    elif rows:
        for _ in range(chance.choice([1, 1, rows])):
            values[chance.randrange(rows)] = chance.choice(EXTREMES)
        try:
            made = pa.array(values)
        except (pa.ArrowException, OverflowError):
            made = pa.array([None if value is None else str(value) for value in values])
    return table.set_column(column, name, made)


def edited_mcap(chance: random.Random, raw: bytes) -> bytes:
    """Values of messages in JSON replaced, bytes of others, and messages lost or doubled, in a whole file."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    messages = list(make_reader(io.BytesIO(raw)).iter_messages())
    chosen = {chance.randrange(len(messages)) for _ in range(chance.choice([1, 1, 2, 10]))}
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    channels: dict[int, int] = {}
    for number, (schema, channel, message) in enumerate(messages):
        assert schema is not None
        if channel.id not in channels:
            known = writer.register_schema(name=schema.name, encoding=schema.encoding, data=schema.data)
            channels[channel.id] = writer.register_channel(
                channel.topic, message_encoding=channel.message_encoding, schema_id=known
            )
        data, copies = message.data, 1
        if number in chosen:
            kind = chance.random()
            copies = chance.choice([0, 2]) if kind < 0.1 else 1
            if kind > 0.3 and channel.message_encoding == "json":
                text = json.dumps(edited_tree(chance, json.loads(data)), ensure_ascii=chance.random() < 0.5)
                data = text.encode(errors="surrogatepass")
            elif kind > 0.1:
                data = edited_bytes(chance, data)
        for _ in range(copies):
            writer.add_message(
                channels[channel.id], log_time=message.log_time, data=data, publish_time=message.publish_time
            )
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def containers_of(node: Any) -> list[Any]:
    """Every mapping and list of a tree, the outer before the inner."""
    children = node.values() if isinstance(node, dict) else node if isinstance(node, list) else []
    own = [node] if isinstance(node, dict | list) else []
    return own + [inner for child in children for inner in containers_of(child)]


def _keys(tree: Any) -> list[str]:
    return [key for node in containers_of(tree) if isinstance(node, dict) for key in node]


def damage(chance: random.Random, file: Path) -> None:
    """Edit a file: the values or the text of JSON, the cells of a Parquet table, else its bytes."""
    raw, kind = file.read_bytes(), chance.random()
    if file.suffix == ".json" and kind < 0.7:
        file.write_text(json.dumps(edited_tree(chance, json.loads(raw))), encoding="utf-8")
    elif file.suffix == ".json" and kind < 0.85:
        file.write_text(edited_text(chance, raw.decode()), encoding="utf-8", errors="surrogatepass")
    elif file.suffix == ".parquet" and kind < 0.8:
        pq.write_table(edited_table(chance, pq.read_table(file)), file)
    else:
        file.write_bytes(edited_bytes(chance, raw))
