"""Runs the queries of docs/lake on a lake and compares their results with the files next to them.

    lake_queries.py LAKE FOLDER              compares
    lake_queries.py LAKE FOLDER --write      writes the files
    lake_queries.py LAKE FOLDER --only-run   any result passes
"""

import glob
import os
import sys

import duckdb


def table(connection, query):
    """The result as lines, with a bar between cells."""
    result = connection.sql(query)
    rows = [result.columns, *result.fetchall()]
    cells = [["" if cell is None else str(cell) for cell in row] for row in rows]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    lines = [" | ".join(f"{cell:<{width}}" for cell, width in zip(row, widths)).rstrip() for row in cells]
    return "\n".join(lines) + "\n"


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    lake, folder = sys.argv[1:3]
    connection = duckdb.connect()
    connection.execute("SET VARIABLE lake = $lake", {"lake": lake})
    with open(os.path.join(folder, "views.sql"), encoding="utf-8") as file:
        connection.execute(file.read())
    queries = [path for path in sorted(glob.glob(os.path.join(folder, "*.sql"))) if not path.endswith("views.sql")]
    assert len(queries) >= 5, queries
    for path in queries:
        with open(path, encoding="utf-8") as file:
            found = table(connection, file.read())
        if "--only-run" in sys.argv:
            continue
        result = path.replace(".sql", ".txt")
        if "--write" in sys.argv:
            with open(result, "w", encoding="utf-8", newline="\n") as file:
                file.write(found)
        with open(result, encoding="utf-8") as file:
            expected = file.read()
        if found != expected:
            sys.exit(f"{path}: found\n{found}expected\n{expected}")


if __name__ == "__main__":
    main()
