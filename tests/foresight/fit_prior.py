"""Fits the weights from which refinement starts (config/models/refine-prior.toml) to the train writers of all four sets.

`python3 tests/foresight/fit_prior.py DATA OUT.toml`: DATA is the folder of the recorded data sets. From the shipped curves, every
coefficient and reach in turn is moved to where the corrected preview has less squared error in the first letters of hands never seen
before, until no move of a coefficient helps. The error is the geometric mean over sets and over four leads of samples with no jump
before the lead (`open_loop`). OPEN_LOOP is that program (default: built here). Some twenty minutes on two cores.
"""

import concurrent.futures
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
PRIOR = ROOT / "config/models/refine-prior.toml"
# First letters of each hand, and every which hand.
SETS = {"unipen-tos": (6, 3), "unipen-ced": (6, 1), "pendigits-orig": (6, 3), "character-trajectories": (60, 1)}
LEADS = ("7", "17", "35", "55")
# First and last move: of an amplitude or base, and by which a reach is multiplied.
MOVE, LEAST_MOVE, STRETCH = 0.2, 0.04, 1.5
TERMS = ("left", "innovation", "velocity", "acceleration")


def program() -> str:
    if path := os.environ.get("OPEN_LOOP"):
        return path
    subprocess.run(["cargo", "build", "--release", "--locked", "-p", "foretrace-lab", "--example", "open_loop"], cwd=ROOT, check=True)
    return str(ROOT / "target/release/examples/open_loop")


def written(prior: dict) -> str:
    """The file, without the comment at its head."""
    lines = []
    for kind in ("coarse", "clean"):
        lines.append(f"\n[{kind}]")
        for term in TERMS:
            curve = prior[kind][term]
            parts = ", ".join(
                f'{{ amplitude = {p["amplitude"]}, shape = "{p["shape"]}", reach_steps = {p["reach_steps"]} }}' for p in curve["parts"]
            )
            lines.append(f"{term} = {{ base = {curve['base']}, parts = [{parts}] }}")
    return "\n".join(lines) + "\n"


def coefficients(prior: dict) -> list[tuple[dict, str]]:
    curves = [prior[kind][term] for kind in ("coarse", "clean") for term in TERMS]
    return [place for c in curves for place in [(c, "base")] + [(p, key) for p in c["parts"] for key in ("amplitude", "reach_steps")]]


class Judge:
    def __init__(self, data: pathlib.Path, scratch: pathlib.Path) -> None:
        self.data, self.scratch, self.program = data, scratch, program()
        self.pool = concurrent.futures.ThreadPoolExecutor(2)

    def error(self, prior: dict) -> float:
        """Mean logarithm of the squared error; infinite where the program refuses the prior."""
        file = self.scratch / "prior.toml"
        file.write_text(written(prior), encoding="utf-8")
        try:
            logs = [log for logs in self.pool.map(lambda name: self.of_set(name, file), SETS) for log in logs]
        except subprocess.CalledProcessError:
            return math.inf
        return sum(logs) / len(logs)

    def of_set(self, name: str, file: pathlib.Path) -> list[float]:
        limit, every = SETS[name]
        words = [self.program, str(self.data / name), str(limit), str(every), "train", f"predictor.refine.prior={file}"]
        lines = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
        rows = [line.split() for line in lines if line.split()[1:2] == ["ms"]]
        errors = {row[0]: float(row[-1]) for row in rows}
        return [math.log(errors[lead]) for lead in LEADS]


def main() -> int:
    data, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    prior = tomllib.loads(PRIOR.read_text(encoding="utf-8"))
    places = coefficients(prior)
    moves = [MOVE] * len(places)
    with tempfile.TemporaryDirectory() as scratch:
        judge = Judge(data, pathlib.Path(scratch))
        best = judge.error(prior)
        print(f"{math.exp(best):.4e} m² before", flush=True)
        while any(move >= LEAST_MOVE for move in moves):
            for index, (curve, key) in enumerate(places):
                move = moves[index]
                if move < LEAST_MOVE:
                    continue
                old = curve[key]
                stretch = STRETCH ** (move / MOVE)
                for new in (old * stretch, old / stretch) if key == "reach_steps" else (old + move, old - move):
                    curve[key] = round(new, 2)
                    found = judge.error(prior)
                    if found < best:
                        best = found
                        break
                    curve[key] = old
                else:
                    moves[index] = move / 2
            print(f"{math.exp(best):.4e} m²", flush=True)
            out.write_text(written(prior), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
