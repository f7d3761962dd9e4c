"""What the examples of networks share: their training data, Adam, the lab's protocol, and predicting live.

A network predicts the mean displacement per step until each of LEADS, relative to a typical one. Its module has weights,
a loss with its gradients, and a subclass of Pen. Needs numpy; predicting live also the package foretrace.
"""

import argparse
import csv
import json
import os
import pathlib
import sys

# One thread: sums keep their order, and the machine its other cores.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

#: Steps ahead that the network predicts; between them its path is straight.
LEADS = np.array([1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 40])
#: Typical displacement in the lab's and the loop's running scale, and the longest that the network sees, in these units.
TYPICAL, LONGEST = 10.0, 4.0


# Training.


def log_loss(errors, known):
    """Mean over the leads of the log of the mean squared error, and its slope; errors: steps x rows x leads x 2, where known."""
    squares, counts = (errors**2).sum(axis=(0, 1, 3)) + 1e-9, 2.0 * np.maximum(known.sum(axis=(0, 1)), 1.0)
    return np.log(squares / counts).mean(), 2.0 * errors / squares[:, None] / len(LEADS)


def characters(folder, step_s):
    """Displacements and where the pen was lifted, of every exported character, at this step; both phases where it is a multiple."""
    found, points = [], {}
    for file in sorted(pathlib.Path(folder).glob("*-points.csv")):
        with open(file, newline="", encoding="utf-8") as lines:
            for row in csv.DictReader(lines):
                points.setdefault((file.name, row["file"], int(row["segment"])), []).append([float(row[key]) for key in ("t_s", "x", "y", "stroke_start")])
    for _, rows in sorted(points.items()):
        rows = np.array(rows)
        own = np.median(np.diff(rows[:, 0])) if len(rows) > 1 else step_s
        every = round(step_s / own)
        if every < 1 or abs(every * own / step_s - 1.0) > 0.02:
            continue
        for phase in range(every):
            at = np.arange(phase, len(rows), every)
            if len(at) > 8:
                found.append((np.diff(rows[at, 1:3], axis=0), np.diff(np.cumsum(rows[:, 3])[at]) > 0.0))
    return found


def scaled(v, scale=None, weight=20.0):
    """The displacements over their running scale, as the lab and the loop have it, roughly."""
    lengths, out = np.hypot(v[:, 0], v[:, 1]), np.zeros_like(v)
    mean = None if scale is None else 2.0 * scale**2
    for t, length in enumerate(lengths):
        if length > 0.0:
            mean = length**2 if mean is None else mean
            weight = min(weight + 1.0, 500.0)
            mean += (min(length, 3.0 * np.sqrt(mean)) ** 2 - mean) / weight
        out[t] = v[t] / np.sqrt(0.5 * mean) if mean else 0.0
    return out


def clipped(x):
    length = np.hypot(x[..., 0], x[..., 1])[..., None]
    return x * np.minimum(1.0, LONGEST / np.maximum(length, LONGEST))


def batches(found, steps, rows, rng):
    """Without end: inputs, targets and which of them count, each character turned and resized."""
    ready = []
    for v, lifted in found:
        rms = np.sqrt(0.5 * np.mean(np.sum(v[~lifted] ** 2, axis=1))) if (~lifted).any() else 0.0
        if rms > 0.0:
            # The scale has been learned from what was written before.
            ready.append((scaled(v, rms, 200.0), lifted))
    if not ready:
        sys.exit("no character has this step: give points that `foretrace lab leadtime --export-targets` wrote, or another --step-ms")
    while True:
        x, target, known = np.zeros((steps, rows, 2)), np.zeros((steps, rows, len(LEADS), 2)), np.zeros((steps, rows, len(LEADS)))
        for row in range(rows):
            v, lifted = ready[rng.integers(len(ready))]
            first = rng.integers(max(1, len(v) - steps // 2))
            v, lifted = v[first:], lifted[first:]
            turn, size = rng.uniform(-0.3, 0.3), np.exp(rng.uniform(-0.3, 0.3))
            v = size * v @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
            here = min(steps, len(v))
            x[:here, row] = clipped(v[:here])
            path = np.vstack([np.zeros(2), np.cumsum(v, axis=0)])
            lifts = np.append(0, np.cumsum(lifted))
            for index, lead in enumerate(LEADS):
                count = min(here, len(v) - lead)
                if count > 0:
                    # Past step t the path is at t + 1; no lift in the step itself or until the target.
                    target[:count, row, index] = (path[1 + lead : 1 + lead + count] - path[1 : 1 + count]) / lead
                    known[:count, row, index] = lifts[1 + lead : 1 + lead + count] == lifts[:count]
        yield x, target, known


def fit(weights, source, loss_and_gradients, updates):
    """Adam on the weights, the step falling to zero; the gradient's length bounded."""
    moments = {name: [np.zeros_like(value), np.zeros_like(value)] for name, value in weights.items()}
    recent = None
    for update in range(1, updates + 1):
        loss, gradients = loss_and_gradients(weights, *next(source))
        length = np.sqrt(sum(float((g**2).sum()) for g in gradients.values()))
        rate, shorter = 2e-3 * (1.0 + np.cos(np.pi * update / updates)), min(1.0, 1.0 / max(length, 1e-12))
        for name, gradient in gradients.items():
            first, second = moments[name]
            first += 0.1 * (shorter * gradient - first)
            second += 0.001 * ((shorter * gradient) ** 2 - second)
            weights[name] -= rate * (first / (1.0 - 0.9**update)) / (np.sqrt(second / (1.0 - 0.999**update)) + 1e-8)
        recent = loss if recent is None else recent + 0.02 * (loss - recent)
        if update % max(1, updates // 10) == 0:
            print(f"{update} of {updates}: log of the squared error {recent:.3f}", file=sys.stderr)
    return weights


def save(file, step_s, weights):
    with open(file, "wb") as out:
        np.savez(out, step_s=step_s, **{name: weights[name] for name in sorted(weights)})


# Predicting.


class Pen:
    """A network's memory of one pen. A subclass has forget(), take(x), and ahead(), leads x 2."""

    def __init__(self, file):
        stored = np.load(file)
        self.w = {name: stored[name] for name in stored.files if name != "step_s"}
        self.step_s = float(stored["step_s"])
        self.forget()

    def fits(self, step_s):
        if not abs(step_s / self.step_s - 1.0) < 0.02:
            sys.exit(f"the weights are for steps of {1e3 * self.step_s:g} ms, asked for are {1e3 * step_s:g} ms: train with --step-ms {1e3 * step_s:g}")

    def observe(self, dx, dy, scale, continues):
        if not continues:
            self.forget()
            return
        self.take(clipped(np.array([[dx, dy]]) / (TYPICAL * scale)))

    def positions(self, x, y, scale, wanted):
        """So many positions from (x, y) on; beyond the farthest lead the pen rests."""
        path = np.vstack([np.zeros(2), self.ahead() * LEADS[:, None]]) * TYPICAL * scale
        steps = np.arange(1, wanted + 1)
        both = [start + np.interp(steps, np.append(0, LEADS), path[:, axis]) for axis, start in enumerate((x, y))]
        return np.column_stack(both).tolist()


def serve(pen, lines, out):
    """The lab's protocol: a line for a line."""
    for line in lines:
        told, answer = json.loads(line), {}
        if "step" in told:
            step = told["step"]
            pen.observe(step["dx"], step["dy"], step["scale"], step["motion"] == "continues")
            if step["wanted"]:
                answer = {"positions": pen.positions(step["x"], step["y"], step["scale"], step["wanted"])}
        else:
            pen.fits(told["step_s"])
        out.write(json.dumps(answer) + "\n")
        out.flush()


def live(pen, instance):
    import foretrace
    from foretrace.messages import PenMotion

    with foretrace.attach(instance) as ft, ft.predictor_interface() as predictor:
        ft.predictor("external")
        last = None
        for step in predictor:
            pen.fits(step.step_ns * 1e-9)
            # Where a step was lost its displacement is missing: what the network remembers leads elsewhere.
            follows = step.motion == PenMotion.CONTINUES and last is not None and step.index == last + 1
            last = step.index
            pen.observe(step.dx_m, step.dy_m, step.scale_m, follows)
            predictor.send(step, pen.positions(step.x_m, step.y_m, step.scale_m, step.wanted))


def main(what, pen, train, cells):
    """The command line: `train(folder, step_s, updates, cells, seed)` gives weights, `pen(file)` predicts with them."""
    parser = argparse.ArgumentParser(description=f"{what} that predicts the pen: trains, serves the lab on standard input and output, or predicts live")
    parser.add_argument("--weights", required=True, help="file of the network; --train writes it")
    parser.add_argument("--train", metavar="FOLDER", help="folder of points that `foretrace lab leadtime --export-targets` wrote")
    parser.add_argument("--step-ms", type=float, default=5.0, help="step of the network: the device's in tables, pen.step_ms (10) in the loop")
    parser.add_argument("--updates", type=int, default=2500)
    parser.add_argument("--cells", type=int, default=cells)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--live", type=int, metavar="INSTANCE", help="predict for this daemon")
    args = parser.parse_args()
    if args.train is not None:
        step_s = args.step_ms * 1e-3
        save(args.weights, step_s, train(args.train, step_s, args.updates, args.cells, args.seed))
    elif args.live is not None:
        live(pen(args.weights), args.live)
    else:
        serve(pen(args.weights), sys.stdin, sys.stdout)
