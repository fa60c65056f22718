"""Questions to an archive in SQL, by DuckDB: it reads of the objects what a question needs, and writes nothing.

| view | a row is |
|---|---|
| `runs` | an archived run, with the SHA-256 of its run.json |
| `metrics` | one side of a metric of a run: value, U, limits, verdict |
| `traces` | a sample of a trace: the eight channels |
| `files` | a file of a run: name, bytes, SHA-256 |
"""

# ruff: noqa: S608 - the names in these statements are constants, and those of objects are quoted

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from station.archive.found_again import FULL, TRACE
from station.archive.full_rows import OF_A_FILE, OF_A_RUN
from station.archive.place import INSTALL, Place
from station.archive.settings import S3, ArchiveError
from station.archive.trace_rows import FIGURES

if TYPE_CHECKING:
    import duckdb

_RUN = ", ".join(name for name, _ in OF_A_RUN)
_FILE = ", ".join(name for name, _ in OF_A_FILE)
VIEWS = {
    "runs": (FULL, f"SELECT {_RUN}, sha256 FROM {{objects}} WHERE name = 'run.json'"),
    "metrics": (FULL, "SELECT run, unnest(metrics, recursive := true) FROM {objects} WHERE name = 'run.json'"),
    "files": (FULL, f"SELECT run, {_FILE} FROM {{objects}}"),
    "traces": (TRACE, f"SELECT run, {', '.join(FIGURES)}, segment FROM {{objects}}"),
}
"""Name of a view, the folder of its objects, and how it is made of them."""


@dataclass(frozen=True)
class Answer:
    """Columns and rows of an answer; more: there are more rows than were asked for."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    more: bool


def ask(place: Place, sql: str, most: int) -> Answer:
    """Return the answer to a question.

    most: rows that are read.

    Raises:
        ArchiveError: DuckDB is not installed, the archive is empty, or the question cannot be answered.

    """
    try:
        import duckdb  # noqa: PLC0415 - of the extra `plant`
    except ImportError as error:
        raise ArchiveError(f"DuckDB is not installed. {INSTALL}") from error
    connection = duckdb.connect(":memory:")
    try:
        _open(connection, place)
        asked: duckdb.DuckDBPyConnection | None = connection.execute(sql)  # None of a text without a statement
        if asked is None or not asked.description:
            raise ArchiveError("the SQL statement is empty. Write a SELECT")
        rows = asked.fetchmany(most + 1)
        columns = tuple(str(one[0]) for one in asked.description)
        return Answer(columns, tuple(tuple(row) for row in rows[:most]), len(rows) > most)
    except duckdb.Error as error:
        raise ArchiveError(
            f"the SQL statement failed: {_first_line(error)}. Correct it; it can read {', '.join(VIEWS)}"
        ) from error
    finally:
        connection.close()


def _open(connection: duckdb.DuckDBPyConnection, place: Place) -> None:
    """Make the views, then shut the door: a question reads the archive and nothing else of this computer."""
    begins = ""
    if place.settings.scheme == S3:
        begins = f"{place.fs.protocol}://"
        connection.register_filesystem(place.fs)
    for name, (folder, made) in VIEWS.items():
        paths = [place.path(one) for one in place.names(folder) if one.endswith(".parquet")]
        if not paths:
            if folder == FULL:
                raise ArchiveError(f"the archive {place.settings.url} has no runs yet. Run 'lostmotion archive push'")
            continue
        listed = ", ".join(_quoted(f"{begins}{path}") for path in paths)
        objects = f"read_parquet([{listed}], hive_partitioning = false)"
        connection.execute(f"CREATE VIEW {name} AS {made.format(objects=objects)}")
    connection.execute(f"SET allowed_directories = [{_quoted(f'{begins}{place.settings.root}/')}]")
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0].rstrip(".")
