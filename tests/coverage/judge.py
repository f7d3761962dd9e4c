"""Judges the 50 and 90 % bands of `mixture` by split conformal prediction: judge.py PROGRAM SET SCRATCH.

Predictions are `foretrace lab leadtime`'s own, with every bit, from the file of its only shard; true positions come from the points that
--export-targets writes, and are worked out here. crepes fits its radii to the errors on the part `train`, one group per look-ahead time, with
the pen's newest step as the difficulty, and judges them on the part `test`. The same radii then go through the lab as predictions from a file:
its coverage must be crepes' own. Beside that stands the coverage of our bands, which the same code counted. Fails where the lab counts
otherwise than crepes, where our errors are not those worked out here, or where our bands are off by more than OURS_OFF at a look-ahead time.
Source: Vovk, Gammerman, Shafer 2005, Algorithmic Learning in a Random World; Bostrom 2022, crepes.
"""

import base64
import csv
import json
import math
import pathlib
import struct
import subprocess
import sys

import numpy
from crepes import ConformalRegressor

# Shares that bands promise [%].
PROMISED = [50, 90]
# A share that is counted twice from the same numbers may differ by targets that lie on the circle itself [%].
COUNT_OFF = 0.05
# Bands that learn while they are scored, beside what they promise [%].
OURS_OFF = 5.0
# The times of exported points have six decimals.
ERROR_OFF = 1e-4
# Digits that a position loses on its way through a text.
LENGTH_OFF = 1e-9


class Part:
    """One part of a set: our predictions, the true errors, and how far the pen went last [raw units]."""

    def __init__(self, program, folder, word, scratch):
        place = scratch / f"{folder.name}-{word}"
        common = ["lab", "leadtime", "--data", str(folder), "--split", word]
        run(program, *common, "--export-targets", str(place))
        run(program, *common, "--models", "mixture", "--shard", "1/1", "--json", str(place / "shard.json"))
        self.common, self.place = common, place
        points = {}
        for row in csv.DictReader((place / f"{folder.name}-points.csv").open()):
            character = points.setdefault((row["file"], row["segment"]), [])
            character.append((float(row["t_s"]), float(row["x"]), float(row["y"])))
        self.targets = list(csv.DictReader((place / f"{folder.name}-targets.csv").open()))
        lane = json.loads((place / "shard.json").read_text())["part"]["sets"][0]["lanes"][0]
        raw = base64.b64decode(lane["predicted"])
        moved = numpy.array(struct.unpack(f"<{len(raw) // 8}d", raw)).reshape(-1, 2)
        if len(moved) != len(self.targets):
            sys.exit(f"coverage: {len(moved)} predictions for {len(self.targets)} targets of {folder}")
        self.leads = numpy.array([int(row["lead"]) for row in self.targets])
        self.predicted = numpy.empty_like(moved)
        self.errors, self.steps = numpy.empty(len(moved)), numpy.empty(len(moved))
        for index, row in enumerate(self.targets):
            path, t = points[row["file"], row["segment"]], int(row["t"])
            self.predicted[index] = numpy.array(path[t][1:]) + moved[index]
            at = t + int(row["lead"]) / 1000.0 / (path[1][0] - path[0][0]) if len(path) > 1 else t
            self.errors[index] = math.dist(self.predicted[index], between(path, at))
            self.steps[index] = math.dist(path[t][1:], path[t - 1][1:])
        # A pen that rests has no step; what it does next is no certainty.
        self.steps = numpy.maximum(self.steps, numpy.median(self.steps) * 0.1)


def between(path, at):
    """The path at a fractional index, straight between its points."""
    index = min(math.floor(at + 1e-6), len(path) - 1)
    share = min(max(at - index, 0.0), 1.0)
    (_, x, y), (_, x1, y1) = path[index], path[min(index + 1, len(path) - 1)]
    return x + share * (x1 - x), y + share * (y1 - y)


def run(program, *words):
    done = subprocess.run([program, *words], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"coverage: {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout


def conformal(train, test):
    """crepes' radii for the targets of `test` by share, and its own figures of their coverage by share and look-ahead time [%]."""
    radii, coverage = {share: numpy.empty(len(test.errors)) for share in PROMISED}, {}
    for lead in sorted(set(test.leads)):
        here, there = train.leads == lead, test.leads == lead
        regressor = ConformalRegressor()
        regressor.fit(residuals=train.errors[here], sigmas=train.steps[here])
        zero = numpy.zeros(there.sum())
        for share in PROMISED:
            asked = {"sigmas": test.steps[there], "confidence": share / 100.0}
            radii[share][there] = regressor.predict_int(zero, **asked)[:, 1]
            judged = regressor.evaluate(zero, y=test.errors[there], metrics=["error"], **asked)
            coverage[share, lead] = 100.0 * (1.0 - judged["error"])
    return radii, coverage


def main() -> int:
    program, folder, scratch = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
    train, test = (Part(program, folder, word, scratch) for word in ("train", "test"))
    radii, coverage = conformal(train, test)
    theirs = test.place / "crepes.csv"
    with theirs.open("w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["file", "segment", "t", "lead", "x", "y", "r50", "r90"])
        for row, *numbers in zip(test.targets, *test.predicted.T, *(radii[share] for share in PROMISED)):
            name = [row["file"], row["segment"], row["t"], row["lead"]]
            table.writerow([*name, *(repr(float(number)) for number in numbers)])
    result = test.place / "board.json"
    names = f"mixture,file:{theirs}"
    run(program, *test.common, "--models", names, "--out", str(test.place), "--json", str(result))
    ours, lab = (lane["leads"] for lane in json.loads(result.read_text())["sets"][0]["models"])
    problems = []
    print(f"{folder.name}: {len(test.targets)} targets of the part test; coverage of bands [%]; mean radius [as `lab leadtime`]")
    print("lead [ms]   band   mixture   crepes   crepes, counted by the lab   radius: mixture   crepes")
    for our, their in zip(ours, lab):
        lead = our["lead_ms"]
        if (PROMISED[0], lead) not in coverage or our["coverage_90"] is None:
            continue
        for share in PROMISED:
            covered, counted = our[f"coverage_{share}"], their[f"coverage_{share}"]
            # The lab has the mean radius of the wide ones.
            wide = f"{our['radius_90']:>17.3f} {their['radius_90']:>8.3f}" if share == 90 else ""
            print(f"{lead:>9} {share:>6} {covered:>9.1f} {coverage[share, lead]:>8.1f} {counted:>28.1f} {wide}")
            if abs(counted - coverage[share, lead]) > COUNT_OFF:
                problems.append(f"{lead} ms: the lab counts {counted:.2f} % of crepes' {share} % bands, crepes {coverage[share, lead]:.2f} %")
            if abs(covered - share) > OURS_OFF:
                problems.append(f"{lead} ms: our {share} % bands hold {covered:.1f} %")
        # Millimetres, or whatever the board's unit is, per raw unit.
        there = test.leads == lead
        unit = their["radius_90"] / radii[90][there].mean()
        here = unit * math.sqrt((test.errors[there] ** 2).mean())
        if abs(here - our["rms"]) > ERROR_OFF * our["rms"]:
            problems.append(f"{lead} ms: the error is {our['rms']}, worked out here {here}")
        if abs(their["rms"] - our["rms"]) > LENGTH_OFF * our["rms"]:
            problems.append(f"{lead} ms: the same predictions have two errors: {our['rms']} and {their['rms']}")
    if not problems and not any(row["coverage_90"] for row in ours):
        problems.append("no look-ahead time has bands")
    for problem in problems:
        print(f"coverage: {folder.name}: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
