"""Mutates a seeded sample of the control law and runs its tests against each mutant. Needs cargo-mutants (`cargo install cargo-mutants`).

`python3 .ci/mutants.py [COUNT [SEED]]`: COUNT (default 200) mutants of foretrace-control. At least 90 % of those that compile must be
caught, those aside that `.ci/mutants.toml` argues to be equivalent. Writes nothing into the tree.
"""

import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
LEAST = 0.9


def mutants(*arguments: str, check: bool = True) -> str:
    words = ["cargo", "mutants", "--dir", str(ROOT), "--package", "foretrace-control", *arguments]
    return subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=check).stdout


def main() -> int:
    if shutil.which("cargo-mutants") is None:
        print("skipped: cargo-mutants is not installed")
        return 0
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    everything = sorted({entry["name"] for entry in json.loads(mutants("--list", "--json"))})
    sample = random.Random(seed).sample(everything, min(count, len(everything)))
    argued = tomllib.loads((ROOT / ".ci/mutants.toml").read_text(encoding="utf-8"))["equivalent"]
    tally = {"CaughtMutant": 0, "MissedMutant": 0, "Timeout": 0, "Unviable": 0}
    missed = []
    with tempfile.TemporaryDirectory() as out:
        # Names hold brackets and operators; each is given as an exact pattern.
        patterns = [word for name in sample for word in ("--re", f"^{escaped(name)}$")]
        mutants("--output", out, "--timeout", "300", "--colors", "never", *patterns, check=False)
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
    open_ones = [name for name in missed if not any(place["mutant"] in name for place in argued)]
    caught = tally["CaughtMutant"] + tally["Timeout"]
    viable = caught + len(open_ones)
    for name in missed:
        print(("missed: " if name in open_ones else "argued as equivalent: ") + name)
    share = caught / viable if viable else 0.0
    print(f"seed {seed}: {len(sample)} of {len(everything)} mutants, {tally['Unviable']} do not compile, {caught} of {viable} caught: {share:.1%}")
    return 0 if share >= LEAST else 1


def escaped(name: str) -> str:
    return "".join("\\" + c if c in r"\.+*?()|[]{}^$#&-~" else c for c in name)


if __name__ == "__main__":
    sys.exit(main())
