"""SQLite files of others hold tables, and nothing that computes rows: a view may have no end."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.support.ros_bags import Messages, write_bag
from tests.support.traffic_files import write_smarts

from trackbench.base.databases import open_tables
from trackbench.base.errors import InputError
from trackbench.truth.tracks import TRAFFIC_FORMATS

#: CPU time of a refusal, s.
SOON = 1.0
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
STATES = "i AS vehicle_id, i AS sim_time, 1.0 AS position_x, 1.0 AS position_y, 0.0 AS heading_rad, 1.0 AS speed"
#: Of 200 MB, made for each row that is read.
LARGE = "(length(hex(zeroblob(100000000))))"
TRAJECTORY = f"CREATE VIEW Trajectory AS {ENDLESS} SELECT {STATES} FROM n"
SMARTS = {
    "endless": (f"DROP TABLE Trajectory; {TRAJECTORY}", "'Trajectory' is a view"),
    "no row": (f"DROP TABLE Trajectory; {TRAJECTORY} WHERE i < 0", "'Trajectory' is a view"),
    "sizes": (
        f"DROP TABLE Vehicle; CREATE VIEW Vehicle AS {ENDLESS} SELECT i AS id, 2 AS type, 1.0 AS length, 1 AS width "
        "FROM n",
        "'Vehicle' is a view",
    ),
    "beside": (f"{TRAJECTORY.replace('Trajectory', 'Other')}", "'Other' is a view"),
    "forged": (
        f"PRAGMA writable_schema=ON; UPDATE sqlite_master SET sql='{TRAJECTORY}' WHERE name='Trajectory'",
        "not an SQLite database that can be read: malformed database schema",
    ),
    "computed": (f"ALTER TABLE Trajectory ADD COLUMN more AS {LARGE}", "'more' is a generated column"),
    "text index": ("CREATE VIRTUAL TABLE a USING fts5(b)", "'a' is a virtual table"),
    "place index": (
        "DROP TABLE Vehicle; CREATE VIRTUAL TABLE Vehicle USING rtree(id, length, width, a, b)",
        "'Vehicle' is a virtual table",
    ),
    "trigger": ("CREATE TRIGGER t AFTER INSERT ON Trajectory BEGIN SELECT 1; END", "'t' is a trigger"),
}
BAG = {
    "messages": (
        "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS "
        f"{ENDLESS} SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
        "'messages' is a view",
    ),
    "version": (
        f"DROP TABLE schema; CREATE VIEW schema AS {ENDLESS} SELECT i AS schema_version FROM n WHERE i < 0",
        "'schema' is a view",
    ),
    "definitions": (
        f"DROP TABLE message_definitions; CREATE VIEW message_definitions AS {ENDLESS} SELECT i AS id FROM n",
        "'message_definitions' is a view",
    ),
    "computed": (f"ALTER TABLE messages ADD COLUMN more AS {LARGE}", "'more' is a generated column"),
    "doubled": (
        "CREATE TABLE t AS SELECT * FROM topics; DROP TABLE topics; ALTER TABLE t RENAME TO topics;"
        + "INSERT INTO topics SELECT * FROM topics;" * 14,
        "a topic is there twice",
    ),
}


def changed(file: Path, script: str) -> Path:
    """The database after some statements."""
    with closing(sqlite3.connect(file)) as database:
        database.executescript(script)
    return file


def refusal(read: Callable[[], Any]) -> str:
    """What is said of a file, soon."""
    begin = time.process_time()
    with pytest.raises(InputError) as caught:
        read()
    assert time.process_time() - begin < SOON
    return str(caught.value)


@pytest.mark.parametrize("name", SMARTS)
def test_a_traffic_history_that_computes_rows_is_refused(tmp_path: Path, name: str) -> None:
    script, expected = SMARTS[name]
    file = changed(write_smarts(tmp_path), script)
    assert refusal(lambda: TRAFFIC_FORMATS["smarts"]().rows(file)).startswith(f"{file}: {expected}")  # type: ignore[attr-defined]


def write_messages(folder: Path) -> Path:
    make = Messages()
    return write_bag(folder, [("/a", make.detections(0.1 * k)) for k in range(5)])


@pytest.mark.parametrize("by", ["file", "folder"])
@pytest.mark.parametrize("name", BAG)
def test_so_is_a_bag(tmp_path: Path, name: str, by: str) -> None:
    script, expected = BAG[name]
    file = changed(write_messages(tmp_path), script)
    bag = TRAFFIC_FORMATS["ros"]()
    path = file if by == "file" else file.parent / "metadata.yaml"
    assert refusal(lambda: bag.rows(path)).startswith(f"{file}: {expected}")  # type: ignore[attr-defined]


def test_aliases_in_the_metadata_of_a_bag_are_refused(tmp_path: Path) -> None:
    file = write_messages(tmp_path).parent / "metadata.yaml"
    bag = TRAFFIC_FORMATS["ros"]()
    assert len(bag.rows(file)) == 5  # type: ignore[attr-defined]
    merges = [f"a{n}: &a{n} {{<<: [{f'*a{n - 1}, ' * 10}]}}" for n in range(1, 10)]
    with file.open("a", encoding="utf-8") as stream:
        stream.write("\n".join(["a0: &a0 {x: 1}", *merges]))
    assert "an anchor (&)" in refusal(lambda: bag.rows(file))  # type: ignore[attr-defined]


def test_rows_that_a_join_would_multiply_are_read_once(tmp_path: Path) -> None:
    file = write_smarts(tmp_path)
    smarts = TRAFFIC_FORMATS["smarts"]()
    whole = smarts.rows(file)  # type: ignore[attr-defined]
    copies = "CREATE TABLE v AS SELECT * FROM Vehicle; DROP TABLE Vehicle; ALTER TABLE v RENAME TO Vehicle;"
    changed(file, copies + "INSERT INTO Vehicle SELECT * FROM Vehicle;" * 12)
    read = smarts.rows(file)  # type: ignore[attr-defined]
    assert (len(read), read.id, read.length.tolist()) == (len(whole), whole.id, whole.length.tolist())


def test_tables_and_indices_are_read(tmp_path: Path) -> None:
    file = changed(write_smarts(tmp_path), "CREATE INDEX i ON Trajectory (sim_time); ANALYZE")
    with closing(open_tables(file)) as database, pytest.raises(sqlite3.OperationalError, match="readonly"):
        database.execute("DELETE FROM Trajectory")


def test_what_is_no_database_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.shf").write_bytes(b"SQLite format 3\0" + b"x" * 5000)
    with pytest.raises(InputError, match=r"a\.shf: not an SQLite database that can be read: "):
        open_tables(tmp_path / "a.shf")
    with pytest.raises(FileNotFoundError):
        open_tables(tmp_path / "b.shf")


@pytest.mark.parametrize("column", ["type", "name", "sql"])
def test_a_damaged_database_with_other_bytes_than_utf_8_is_one_message(tmp_path: Path, column: str) -> None:
    file = write_smarts(tmp_path)
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("CREATE TABLE broken (x)")
        database.execute("PRAGMA writable_schema=ON")
        database.execute(f"UPDATE sqlite_master SET {column} = CAST(X'76C576' AS TEXT) WHERE name = 'broken'")
    with pytest.raises(InputError, match=r"database"):
        open_tables(file)
