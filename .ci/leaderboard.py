"""Writes the figures of docs/results/leaderboard.md into leaderboard.csv beside it, from the JSON that its command made.

`python3 .ci/leaderboard.py JSON`, then `python3 .ci/tables.py --bless`. Rows in the order of their standing; programs are named
by the file that they run.
"""

import csv
import json
import pathlib
import re
import sys

FILE = pathlib.Path(__file__).resolve().parent.parent / "docs/results/leaderboard.csv"
SHOWN_MS = (10, 20, 50, 100, 200)
# Key of the program's report, name of the figure, and its digits.
SIDE_EFFECTS = (("error", "error", 3), ("lateness", "late", 3), ("over_anticipation", "ahead", 3), ("wrong_direction_deg", "direction [°]", 0), ("jitter", "jitter", 3))


def name(model: str) -> str:
    program = re.search(r"(\w+)_predictor\.py", model)
    return program[1].upper() if program else model


def text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def ends(interval: list[float] | None, digits: int) -> str:
    return " to ".join(text(end, digits) for end in interval) if interval else ""


def records(report: dict):
    [board] = report["sets"]
    lanes = {lane["model"]: lane["leads"] for lane in board["models"]}
    for standing in report["standings"]:
        row = name(standing["model"])
        yield row, "standing", "rms", text(standing["rms_over_zero"], 3)
        yield row, "standing over writers", "rms", ends(standing["rms_over_zero_interval"], 3)
        for lead in lanes[standing["model"]]:
            if lead["lead_ms"] not in SHOWN_MS:
                continue
            at = f"{lead['lead_ms']} ms"
            yield row, at, "rms", text(lead["rms"], 3)
            yield row, f"{at} over writers", "rms", ends(lead["rms_interval"], 2)
            for key, figure, digits in SIDE_EFFECTS:
                yield row, at, figure, *(text(lead[key][part], digits) for part in ("mean", "p50", "p95", "p99"))


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit("name the JSON that the command in docs/results/leaderboard.md writes")
    report = json.loads(pathlib.Path(sys.argv[1]).read_text(encoding="utf-8"))
    if len(report.get("sets", [])) != 1:
        sys.exit(f"{sys.argv[1]}: not the report of `lab leadtime` on one set")
    with FILE.open("w", encoding="utf-8", newline="") as out:
        lines = csv.writer(out, lineterminator="\n")
        lines.writerow(("row", "at", "figure", "value", "p50", "p95", "p99"))
        lines.writerows([*record, *[""] * (7 - len(record))] for record in records(report))


if __name__ == "__main__":
    main()
