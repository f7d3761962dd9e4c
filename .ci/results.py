"""Runs the closed-loop benchmark and writes its figures into docs/results/closed-loop.csv.

`python3 .ci/results.py DATA [--rows NAMES] [--run all|first]`: DATA is the folder of the recorded data sets; NAMES are
predictors and baselines, separated by commas (default: every row of the file). Only figures of rows that the file has are
replaced; afterwards `python3 .ci/tables.py --bless` writes the tables. Hours for everything, an hour for `--rows mixture`.

`--check`: writes nothing; runs the first letters of `hold` and `mixture` behind the UR5 and fails where a figure differs.
FORETRACE is the program (default: built here).
"""

import argparse
import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
FILE = ROOT / "docs/results/closed-loop.csv"
# Letters of each hand that the run `first` takes.
FIRST = {"unipen-tos": 6, "unipen-ced": 8, "pendigits-orig": 8, "character-trajectories": 60}
# Column of the file, key of the program's report, and how the figure is written.
FIGURES = {
    "sequences": ("sequences", lambda value: str(value)),
    "mse_m2": ("mse_m2", lambda value: f"{value:.2e}"),
    "median_mse_m2": ("median_mse_m2", lambda value: f"{value:.2e}"),
    "lag_ms": ("lag_ms", lambda value: f"{value:.1f}"),
    "rms_jerk_mps3": ("rms_jerk", lambda value: f"{value:.0f}"),
    "worse_percent": ("worse_than_hold_pct", lambda value: f"{value:.2f}"),
    "worst_mm": ("worst_beyond_hold_m", lambda value: f"{value * 1e3:.2f}"),
    "beyond_limits_percent": ("illegal_pct", lambda value: f"{value:.0f}"),
}
# Arms without limits: nothing is beyond them.
UNLIMITED = {"ideal", "delay30"}


def program() -> str:
    if path := os.environ.get("FORETRACE"):
        return path
    subprocess.run(["cargo", "build", "--release", "--locked", "-p", "foretrace"], cwd=ROOT, check=True)
    return str(ROOT / "target/release/foretrace")


def measured(folder: pathlib.Path, run: str, arms: list[str], rows: list[str]) -> dict[tuple[str, str], dict]:
    """The program's report by row and arm. `hold` runs with them, because the others are compared with it."""
    names = ",".join(dict.fromkeys(["hold", *rows]))
    with tempfile.TemporaryDirectory() as scratch:
        report = pathlib.Path(scratch) / "report.json"
        words = [program(), "lab", "closed-loop", "--data", str(folder), "--arms", ",".join(arms), "--predictors", names]
        words += ["--json", str(report), "--out", scratch]
        if run == "first":
            words += ["--limit", str(FIRST[folder.name])]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        found = json.loads(report.read_text(encoding="utf-8"))["rows"]
    return {(row["predictor"], row["arm"]): row for row in found}


def figures(row: dict, hold: dict) -> dict[str, str]:
    written = {column: write(row[key]) for column, (key, write) in FIGURES.items()}
    if row["arm"] in UNLIMITED:
        written["beyond_limits_percent"] = ""
    return {**written, "of_hold": f"{row['mse_m2'] / hold['mse_m2']:.2f}"}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--rows", default="")
    parser.add_argument("--run", choices=["all", "first"])
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    with FILE.open(encoding="utf-8", newline="") as file:
        records = list(csv.DictReader(file))
    wanted = {"hold", "mixture"} if asked.check else set(filter(None, asked.rows.split(",")))
    differences = []
    for run in ["first"] if asked.check else [asked.run] if asked.run else ["first", "all"]:
        for name in FIRST:
            mine = [r for r in records if r["run"] == run and r["set"] == name and (not wanted or r["predictor"] in wanted)]
            if asked.check:
                mine = [r for r in mine if r["arm"] == "ur5"]
            # Arms of the same rows go together: baselines inside the limits have no figure on arms without limits.
            by_rows: dict[tuple[str, ...], list[str]] = {}
            for arm in dict.fromkeys(r["arm"] for r in mine):
                by_rows.setdefault(tuple(r["predictor"] for r in mine if r["arm"] == arm), []).append(arm)
            for rows, arms in by_rows.items():
                found = measured(asked.data / name, run, arms, list(rows))
                for record in (r for r in mine if r["arm"] in arms and r["predictor"] in rows):
                    now = figures(found[record["predictor"], record["arm"]], found["hold", record["arm"]])
                    place = f"{run} {name} {record['predictor']} {record['arm']}"
                    for column, figure in now.items():
                        if figure != record[column]:
                            differences.append(f"{place}: {column} is {figure}, the file says {record[column] or 'nothing'}")
                    if not asked.check:
                        record.update(now)
                print(f"{run} {name}: {', '.join(rows)} on {', '.join(arms)}", flush=True)
            if not asked.check:
                with FILE.open("w", encoding="utf-8", newline="") as file:
                    writer = csv.DictWriter(file, list(records[0]), lineterminator="\n")
                    writer.writeheader()
                    writer.writerows(records)
    for difference in differences:
        print(difference, file=sys.stderr)
    return 1 if asked.check and differences else 0


if __name__ == "__main__":
    sys.exit(main())
