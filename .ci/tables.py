"""Tables of the results that are made from the CSV files beside them: `tables.py --bless` writes them, .ci/invariants.py compares.

A table stands between `<!-- table: FILE KEY=VALUE ... -->` and `<!-- end of table -->`. Keys:
  row, column   columns of the CSV that name the rows and the columns of the table
  value         the column whose figures it shows, as written in the CSV, or times scale with as many digits
  rows, columns which of them, in which order, separated by semicolons (default: all, as in the CSV); bold: a row to stress
  any other     a column of the CSV and what it must be
"""

import csv
import decimal
import pathlib
import re
import shlex
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
TABLE = re.compile(r"(<!-- table: (.*?) -->\n)(.*?)(<!-- end of table -->)", re.DOTALL)
OWN = {"row", "column", "value", "scale", "rows", "columns", "bold"}


def figure(text: str, options: dict[str, str]) -> str:
    if not text or "scale" not in options:
        return text
    return format(decimal.Decimal(text) * decimal.Decimal(options["scale"]), "f")


def made(folder: pathlib.Path, declaration: str) -> str:
    """The table that `declaration` describes. Raises ValueError where it does not fit its file."""
    name, *words = shlex.split(declaration)
    options = dict(word.split("=", 1) for word in words)
    with (folder / name).open(encoding="utf-8", newline="") as file:
        records = list(csv.DictReader(file))
    wanted = {key: value for key, value in options.items() if key not in OWN}
    for key in [*wanted, options["row"], options["column"], options["value"]]:
        if key not in records[0]:
            raise ValueError(f"{name} has no column {key}")
    records = [record for record in records if all(record[key] == value for key, value in wanted.items())]

    def order(kind: str) -> list[str]:
        found = list(dict.fromkeys(record[options[kind]] for record in records))
        chosen = options[kind + "s"].split(";") if kind + "s" in options else found
        if missing := [word for word in chosen if word not in found]:
            raise ValueError(f"{name} has no {kind} {', '.join(missing)} where {wanted}")
        return chosen

    cells = {}
    for record in records:
        place = record[options["row"]], record[options["column"]]
        if place in cells:
            raise ValueError(f"{name} has two figures for {place} where {wanted}")
        cells[place] = figure(record[options["value"]], options)
    columns = order("column")
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for row in order("row"):
        title = f"**{row}**" if row == options.get("bold") else row
        lines.append(f"| {title} | " + " | ".join(cells.get((row, column), "") for column in columns) + " |")
    return "\n".join(lines) + "\n"


def problems(bless: bool) -> list[str]:
    """The differences between the tables and their files. With `bless` the tables are rewritten instead."""
    found, count = [], 0
    for doc in sorted((ROOT / "docs").rglob("*.md")):
        text = doc.read_text(encoding="utf-8")

        def table(match: re.Match[str]) -> str:
            nonlocal count
            count += 1
            try:
                now = f"\n{made(doc.parent, match[2])}\n"
            except (ValueError, OSError, KeyError, IndexError) as error:
                found.append(f"{doc.relative_to(ROOT)}: the table {match[2]}: {error}")
                return match[0]
            if not bless and now != match[3]:
                found.append(f"{doc.relative_to(ROOT)}: the table {match[2]} is not what its file says: python3 .ci/tables.py --bless")
            return match[1] + now + match[4]

        after = TABLE.sub(table, text)
        if bless and after != text:
            doc.write_text(after, encoding="utf-8")
    if count < 10:
        found.append(f"documents have {count} tables made from files, less than 10")
    return found


if __name__ == "__main__":
    for problem in problems("--bless" in sys.argv[1:]):
        sys.exit(problem)
