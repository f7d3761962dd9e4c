"""Mutates a sample of the control law and runs its tests against each mutant. Needs cargo-mutants (`cargo install cargo-mutants`).

`python3 .ci/mutants.py [COUNT [SEED]]`: about COUNT (default 200) mutants of foretrace-control, evenly over its files: every K-th of the
list, from the SEED-th on. At least 90 % of those that compile must be caught, those aside that `.ci/mutants.toml` argues to be
equivalent. Writes nothing into the tree.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
LEAST = 0.9


def command(*arguments: str) -> list[str]:
    return ["cargo", "mutants", "--dir", str(ROOT), "--package", "foretrace-control", *arguments]


def total() -> int:
    words = command("--list", "--json")
    return len(json.loads(subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout))


def environment() -> dict[str, str]:
    """Quick rebuilds; and test programs that stop at their first failure, which the test harness offers as an unstable option only."""
    version = subprocess.run(["rustc", "-vV"], stdout=subprocess.PIPE, text=True, check=True).stdout
    host = next(line.split()[1] for line in version.splitlines() if line.startswith("host:"))
    runner = f"CARGO_TARGET_{host.upper().replace('-', '_')}_RUNNER"
    return {**os.environ, "CARGO_INCREMENTAL": "1", "CARGO_PROFILE_DEV_DEBUG": "0", runner: "env RUSTC_BOOTSTRAP=1"}


def main() -> int:
    if shutil.which("cargo-mutants") is None:
        print("skipped: cargo-mutants is not installed")
        return 0
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    everything = total()
    every = max(everything // max(count, 1), 1)
    seed = (int(sys.argv[2]) if len(sys.argv) > 2 else 1) % every
    argued = tomllib.loads((ROOT / ".ci/mutants.toml").read_text(encoding="utf-8"))["equivalent"]
    tally = {"CaughtMutant": 0, "MissedMutant": 0, "Timeout": 0, "Unviable": 0}
    missed = []
    with tempfile.TemporaryDirectory() as out:
        words = command("--shard", f"{seed}/{every}", "--sharding", "round-robin", "--output", out)
        words += ["--timeout", "200", "--colors", "never", "--", "--lib", "--test", "law"]
        words += ["--", "-Zunstable-options", "--fail-fast"]
        subprocess.run(words, cwd=ROOT, env=environment(), check=False)
        outcomes = json.loads((pathlib.Path(out) / "mutants.out/outcomes.json").read_text(encoding="utf-8"))["outcomes"]
    for outcome in outcomes:
        if outcome["scenario"] == "Baseline":
            if outcome["summary"] != "Success":
                print("the tests fail without a mutant")
                return 1
            continue
        name = outcome["scenario"]["Mutant"]["name"]
        tally[outcome["summary"]] += 1
        if outcome["summary"] == "MissedMutant":
            missed.append(name)
    open_ones = [name for name in missed if not any(place.get("file", "") in name and name.endswith(place["mutant"]) for place in argued)]
    caught = tally["CaughtMutant"] + tally["Timeout"]
    viable = caught + len(open_ones)
    for name in missed:
        print(("missed: " if name in open_ones else "argued as equivalent: ") + name)
    share = caught / viable if viable else 0.0
    tried = sum(tally.values())
    print(f"seed {seed}: {tried} of {everything} mutants, {tally['Unviable']} do not compile, {caught} of {viable} caught: {share:.1%}")
    return 0 if share >= LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
