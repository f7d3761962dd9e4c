"""Mutates samples of the code that moves the arm and runs the tests of its package against each mutant.

Needs cargo-mutants (`cargo install cargo-mutants`). `python3 .ci/mutants.py [law|shell] [COUNT [SEED]]`: about COUNT mutants of a set,
evenly over its files: every K-th of the list, from the SEED-th on. A set has a bound on the share that must be caught, of those that
compile and that `.ci/mutants.toml` does not argue to be equivalent. Writes nothing into the tree.
"""

import dataclasses
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
FAIL_FAST = ["--", "-Zunstable-options", "--fail-fast"]


@dataclasses.dataclass(frozen=True)
class Part:
    """Files of one package, all of them without globs, and the tests that judge them."""

    package: str
    files: tuple[str, ...]
    tests: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Set:
    what: str
    count: int
    least: float
    parts: tuple[Part, ...]


SETS = {
    "law": Set("the law and the guard", 200, 0.9, (Part("foretrace-control", (), ("--lib", "--test", "law")),)),
    "shell": Set(
        "messages, late ticks, the bridge's targets, the guard of served pages",
        100,
        0.85,
        (
            Part("foretrace-shm", ("shm-schema/src/wire/*.rs",), ("--lib", "--test", "wire")),
            Part("foretraced", ("daemon/src/rt/tick.rs", "daemon/src/rt/overruns.rs"), ("--lib",)),
            Part("foretrace-ur", ("client/ur/src/bridge/target*.rs", "client/ur/src/bridge/reaction.rs"), ("--lib",)),
            Part("foretrace-serve", ("client/serve/src/guard.rs",), ("--lib",)),
        ),
    ),
}


def command(part: Part, *arguments: str) -> list[str]:
    files = [word for glob in part.files for word in ("--file", glob)]
    return ["cargo", "mutants", "--dir", str(ROOT), "--package", part.package, *files, *arguments]


def total(part: Part) -> int:
    words = command(part, "--list", "--json")
    return len(json.loads(subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout))


def environment() -> dict[str, str]:
    """Quick rebuilds; and test programs that stop at their first failure, which the test harness offers as an unstable option only."""
    version = subprocess.run(["rustc", "-vV"], stdout=subprocess.PIPE, text=True, check=True).stdout
    host = next(line.split()[1] for line in version.splitlines() if line.startswith("host:"))
    runner = f"CARGO_TARGET_{host.upper().replace('-', '_')}_RUNNER"
    return {**os.environ, "CARGO_INCREMENTAL": "1", "CARGO_PROFILE_DEV_DEBUG": "0", runner: "env RUSTC_BOOTSTRAP=1"}


def tried(part: Part, seed: int, every: int) -> list[tuple[str, str]]:
    """Name and outcome of each mutant in the sample; ends the program where the tests fail without one."""
    with tempfile.TemporaryDirectory() as out:
        words = command(part, "--shard", f"{seed}/{every}", "--sharding", "round-robin", "--output", out)
        words += ["--timeout", "200", "--colors", "never", "--", *part.tests, *FAIL_FAST]
        subprocess.run(words, cwd=ROOT, env=environment(), check=False)
        report = pathlib.Path(out) / "mutants.out/outcomes.json"
        # None is written where the sample of a small part is empty.
        outcomes = json.loads(report.read_text(encoding="utf-8"))["outcomes"] if report.exists() else []
    results = []
    for outcome in outcomes:
        if outcome["scenario"] == "Baseline":
            if outcome["summary"] != "Success":
                sys.exit(f"{part.package}: the tests fail without a mutant")
            continue
        results.append((outcome["scenario"]["Mutant"]["name"], outcome["summary"]))
    return results


def judge(chosen: Set, count: int, wanted_seed: int) -> bool:
    totals = [total(part) for part in chosen.parts]
    every = max(sum(totals) // max(count, 1), 1)
    seed = wanted_seed % every
    argued = tomllib.loads((ROOT / ".ci/mutants.toml").read_text(encoding="utf-8"))["equivalent"]
    results = [result for part in chosen.parts for result in tried(part, seed, every)]
    tally = {kind: sum(summary == kind for _, summary in results) for kind in ("CaughtMutant", "MissedMutant", "Timeout", "Unviable")}
    missed = [name for name, summary in results if summary == "MissedMutant"]
    open_ones = [name for name in missed if not any(one.get("file", "") in name and name.endswith(one["mutant"]) for one in argued)]
    caught = tally["CaughtMutant"] + tally["Timeout"]
    viable = caught + len(open_ones)
    for name in missed:
        print(("missed: " if name in open_ones else "argued as equivalent: ") + name)
    share = caught / viable if viable else 0.0
    print(
        f"{chosen.what}: seed {seed}: {len(results)} of {sum(totals)} mutants, {tally['Unviable']} do not compile, "
        f"{caught} of {viable} caught: {share:.1%} (at least {chosen.least:.0%})"
    )
    return share >= chosen.least


def main() -> int:
    if shutil.which("cargo-mutants") is None:
        print("skipped: cargo-mutants is not installed")
        return 0
    words = sys.argv[1:]
    name = words.pop(0) if words and words[0] in SETS else "law"
    chosen = SETS[name]
    count = int(words[0]) if words else chosen.count
    return 0 if judge(chosen, count, int(words[1]) if len(words) > 1 else 1) else 1


if __name__ == "__main__":
    sys.exit(main())
