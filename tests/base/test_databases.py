"""SQLite files of others hold tables, and nothing that computes rows: a view may have no end."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from tests.support.traffic_files import write_smarts

from trackbench.base.databases import open_tables
from trackbench.base.errors import InputError

TRAJECTORY = "CREATE VIEW Trajectory AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n"


def changed(file: Path, script: str) -> Path:
    """The database after some statements."""
    with closing(sqlite3.connect(file)) as database:
        database.executescript(script)
    return file


def test_a_view_is_refused(tmp_path: Path) -> None:
    file = changed(write_smarts(tmp_path), f"DROP TABLE Trajectory; {TRAJECTORY}")
    with pytest.raises(InputError, match="'Trajectory' is a view"):
        open_tables(file)


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
