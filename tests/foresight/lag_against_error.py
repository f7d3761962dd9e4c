#!/usr/bin/env python3
"""What a lag costs at least: unipen-tos open loop, ridge regression and boosted trees learnt from the train writers.

    python3 tests/foresight/lag_against_error.py SHARED_DATA/unipen-tos [STEPS]

STEPS of 5 ms ahead (default 7). Both are told the last 240 ms of the pen and learn the way to the instant ahead and the velocity
there. The predicted way plus so many ms of the predicted velocity: lag (the shift of the pen that fits best, median over test
sequences) and squared error (mean over test sequences, letters 0.1 m high) as a part of what standing still leaves.
Gaps (.DT) end a piece. Needs numpy and scikit-learn. Exit code: 0, or 77: skipped because one of them is missing,
1: asked for something that cannot be.
"""

import pathlib
import re
import sys

try:
    import numpy as np
    from sklearn.ensemble import HistGradientBoostingRegressor
except ImportError as missing:
    print(f"SKIPPED: {missing}", file=sys.stderr)
    sys.exit(77)

PAST = 48
STEP_MS = 5.0
HEIGHT_M = 0.1
SUMS = [0, 1, 2, 3, 5, 7, 9, 12, 15, 19, 24, 31, 39, 47]
SHIFTS = range(-6, 17)


def sequences(folder: pathlib.Path, file: str) -> list[list[np.ndarray]]:
    """Pieces of every segment of a file, pen up and down alike."""
    text = (folder / file).read_text(errors="replace")
    points = folder / "include" / "tos" / "data" / file.split("tos/")[1]
    components: list[list[tuple[float, float]]] = []
    breaks: set[int] = set()
    for line in points.read_text(errors="replace").splitlines():
        if line.startswith((".PEN_DOWN", ".PEN_UP")):
            if not components or components[-1]:
                components.append([])
        elif line.startswith(".DT"):
            if components and components[-1]:
                components.append([])
            breaks.add(len(components) - 1)
        elif line and not line.startswith(".") and components:
            x, y = line.split()[:2]
            components[-1].append((float(x), float(y)))
    found = []
    for first, last in re.findall(r"^\.SEGMENT \S+ (\d+)(?:-(\d+))? ", text, re.MULTILINE):
        pieces: list[list[tuple[float, float]]] = [[]]
        for index in range(int(first), int(last or first) + 1):
            if index in breaks and pieces[-1]:
                pieces.append([])
            if components[index] != [(0.0, 0.0)]:
                pieces[-1] += components[index]
        arrays = [np.array(piece) for piece in pieces if len(piece) >= 4]
        if sum(map(len, arrays)) >= 15:
            found.append(arrays)
    return found


def cases(pieces: list[np.ndarray], steps: int) -> tuple[np.ndarray, ...] | None:
    """Past displacements (n, 2, PAST; newest first), way and velocity ahead, position now, and the piece, of one sequence."""
    rows: list[tuple[np.ndarray, ...]] = []
    for number, piece in enumerate(pieces):
        now = np.arange(len(piece) - steps)
        if len(now) < 3:
            continue
        padded = np.vstack([np.repeat(piece[:1], PAST, 0), piece])
        windows = np.lib.stride_tricks.sliding_window_view(np.diff(padded, axis=0), PAST, axis=0)
        after, before = np.minimum(now + steps + 1, len(piece) - 1), now + steps - 1
        velocity = (piece[after] - piece[before]) / (after - before)[:, None]
        rows.append((windows[now][:, :, ::-1], piece[now + steps] - piece[now], velocity, piece[now], np.full(len(now), number)))
    return tuple(map(np.concatenate, zip(*rows))) if rows else None


def features(past: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the past in the frame of the motion and its speeds, and that frame (n, 2, 2)."""
    recent = past[:, :, :6].sum(2)
    length = np.linalg.norm(recent, axis=1, keepdims=True)
    along = np.where(length > 1e-9, recent / np.maximum(length, 1e-12), [1.0, 0.0])
    frame = np.stack([along, np.stack([-along[:, 1], along[:, 0]], 1)], 1)
    sums = np.cumsum(frame @ past, 2)[:, :, SUMS]
    return np.concatenate([sums[:, 0], sums[:, 1], np.linalg.norm(past[:, :, :12], axis=1)], 1), frame


def learn(past: np.ndarray, target: np.ndarray):
    """Two predictors of `target`: ridge regression, the same for both axes, and trees on what it leaves."""
    rows, n = past.reshape(-1, PAST), PAST
    gram = rows.T @ rows
    weights = np.linalg.solve(gram + 1e-3 * np.trace(gram) / n * np.eye(n), rows.T @ target.reshape(-1))
    told, frame = features(past)
    left = (frame @ (target - past @ weights)[:, :, None])[:, :, 0]
    chosen = np.random.default_rng(0).choice(len(told), min(len(told), 400_000), replace=False)
    knobs = {"max_iter": 300, "learning_rate": 0.08, "max_leaf_nodes": 63, "min_samples_leaf": 100, "l2_regularization": 1.0}
    trees = [HistGradientBoostingRegressor(**knobs).fit(told[chosen], left[chosen, axis]) for axis in (0, 1)]

    def boosted(past: np.ndarray) -> np.ndarray:
        told, frame = features(past)
        rest = np.stack([tree.predict(told) for tree in trees], 1)
        return past @ weights + (rest[:, None, :] @ frame)[:, 0]

    return {"ridge": lambda past: past @ weights, "trees": boosted}


def lag_ms(tool: np.ndarray, pen: np.ndarray, piece: np.ndarray) -> float:
    def error(shift: int) -> float:
        total = 0.0
        for number in np.unique(piece):
            mine, at = pen[piece == number], tool[piece == number]
            total += np.sum((at - mine[np.clip(np.arange(len(mine)) - shift, 0, len(mine) - 1)]) ** 2)
        return total

    errors = [error(shift) for shift in SHIFTS]
    best = int(np.argmin(errors))
    off = 0.0
    if 0 < best < len(errors) - 1:
        low, middle, high = errors[best - 1 : best + 2]
        bend = low - 2 * middle + high
        off = 0.5 * (low - high) / bend if bend > 0 else 0.0
    return STEP_MS * (SHIFTS[best] + off)


def asked(words: list[str]) -> tuple[pathlib.Path, int]:
    """Folder and steps of the command line; ends the program where they cannot be."""
    if not words or len(words) > 2:
        sys.exit("usage: lag_against_error.py FOLDER [STEPS]: the folder of unipen-tos, and 1 to 40 steps of 5 ms")
    folder, steps = pathlib.Path(words[0]), words[1] if len(words) > 1 else "7"
    if not steps.isdecimal() or not 1 <= int(steps) <= 40:
        sys.exit(f"STEPS is {steps!r}, legal are whole numbers from 1 to 40")
    for needed in ("split.tsv", "include/tos/data"):
        if not (folder / needed).exists():
            sys.exit(f"{folder / needed} is not there: FOLDER has to be the folder of unipen-tos")
    return folder, int(steps)


def main() -> None:
    folder, steps = asked(sys.argv[1:])
    parts: dict[str, list[list[np.ndarray]]] = {"train": [], "test": []}
    for line in (folder / "split.tsv").read_text().splitlines()[1:]:
        part, _, file, *_ = line.split("\t")
        parts[part] += sequences(folder, file)
    median = np.median([max(np.ptp(np.vstack(pieces)[:, 1]), 1.0) for pieces in parts["train"]])
    scaled = {part: [cases([piece * (HEIGHT_M / median) for piece in pieces], steps) for pieces in all] for part, all in parts.items()}
    train, test = ([case for case in scaled[part] if case] for part in ("train", "test"))
    print(f"{len(parts['train'])} train, {len(parts['test'])} test sequences, {steps * STEP_MS:.0f} ms ahead")
    past, way, velocity = (np.concatenate([case[i] for case in train]) for i in range(3))
    ways, velocities = learn(past, way), learn(past, velocity)
    still = np.mean([np.mean(np.sum(way**2, 1)) for _, way, *_ in test])
    for name in ways:
        told = [(ways[name](case[0]), velocities[name](case[0])) for case in test]
        for lead in range(0, 17, 2):
            errors, lags = [], []
            for (_, way, _, position, piece), (claimed, fast) in zip(test, told):
                off = claimed + lead * fast
                errors.append(np.mean(np.sum((off - way) ** 2, 1)))
                lags.append(lag_ms(position + off, position + way, piece))
            print(f"{name}, {lead * STEP_MS:3.0f} ms of velocity: {np.mean(errors) / still:.3f}, lag {np.median(lags):5.1f} ms")


if __name__ == "__main__":
    main()
