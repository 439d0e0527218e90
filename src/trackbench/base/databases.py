"""SQLite databases that a user names: only their tables are read."""

from __future__ import annotations

import sqlite3
import time
from pathlib import Path
from urllib.parse import quote

from trackbench.base.errors import InputError, shortened_text
from trackbench.base.files import require_regular

#: Longest that SQLite may take to read the schema, s, and its instructions between two looks at the clock.
LONGEST, INSTRUCTIONS = 5.0, 10_000
#: Whatever computes rows or acts on them. SQLite goes by the text, whatever the type beside it says.
_OTHERS = """
    SELECT CASE type WHEN 'table' THEN 'virtual table' ELSE type END, name FROM sqlite_master
    WHERE type NOT IN ('table', 'index') OR type = 'table' AND sql NOT LIKE 'CREATE TABLE%'
    UNION ALL SELECT 'generated column', x.name FROM sqlite_master AS m, pragma_table_xinfo(m.name) AS x
    WHERE m.type = 'table' AND x.hidden LIMIT 1
"""


def open_tables(file: Path) -> sqlite3.Connection:
    """Open a database that has tables and indices alone, to be read.

    Raises:
        FileNotFoundError: it is not there.
        InputError: it is no such database: it has a view, a trigger, a virtual table or a generated column.
    """
    require_regular(file)
    database = None
    try:
        database = sqlite3.connect(f"file:{quote(str(file.resolve()))}?mode=ro&immutable=1", uri=True)
        # A damaged file has other bytes than UTF-8 in texts, and in names that messages of SQLite repeat.
        database.text_factory = lambda content: content.decode(errors="replace")
        until = time.monotonic() + LONGEST
        database.set_progress_handler(lambda: time.monotonic() > until, INSTRUCTIONS)
        other = database.execute(_OTHERS).fetchone()
        database.set_progress_handler(None, 0)
        if other is not None:
            kind, name = (shortened_text(str(part), 40) for part in other)
            raise InputError(f"{name!r} is a {kind} of this database, where only tables are read", file=file)
    except BaseException as error:
        if database is not None:
            database.close()
        if isinstance(error, (sqlite3.Error, UnicodeDecodeError)):
            reason = shortened_text(" ".join(str(error).split()))
            raise InputError(f"not an SQLite database that can be read: {reason}", file=file) from None
        raise
    return database
