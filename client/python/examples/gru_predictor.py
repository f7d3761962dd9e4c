"""A predictor of the pen: a GRU in numpy. Trains, serves the lab in lock-step, or predicts live.

    foretrace lab leadtime --data unipen-ced --split train --export-targets points
    python gru_predictor.py --train points --weights gru-5ms.npz               # minutes on one core
    foretrace lab leadtime --data unipen-ced --models 'constant-velocity,external:python gru_predictor.py --weights gru-5ms.npz'
    python gru_predictor.py --live 0 --weights gru-10ms.npz                    # trained with --step-ms 10

Needs numpy, and pen_network.py beside it; --live also the package foretrace. The same seed, points and options give the
same weights on any run.
"""

from pen_network import LEADS, Pen, batches, characters, fit, log_loss, main

import numpy as np

# The network: about thirty lines.


def new_weights(cells, rng):
    """Small random weights; the first prediction is that the pen goes on as it went."""
    wide = 1.0 / np.sqrt(cells)
    shapes = {"wx": (2, 3 * cells), "wh": (cells, 3 * cells), "b": (3 * cells,), "out": (cells, 2 * len(LEADS)), "bias": (2 * len(LEADS),)}
    weights = {name: rng.uniform(-wide, wide, shape) for name, shape in shapes.items()}
    return weights | {"out": 0.1 * weights["out"], "bias": np.zeros(shapes["bias"])}


def sigmoid(a):
    return 1.0 / (1.0 + np.exp(-np.clip(a, -50.0, 50.0)))


def cell(w, h, x):
    """One step of the GRU from state h with input x, both with one row per pen; the new state, and what its gradient needs."""
    n = h.shape[1]
    a, u = x @ w["wx"] + w["b"], h @ w["wh"]
    z, r = sigmoid(a[:, :n] + u[:, :n]), sigmoid(a[:, n : 2 * n] + u[:, n : 2 * n])
    c = np.tanh(a[:, 2 * n :] + r * u[:, 2 * n :])
    return (1.0 - z) * c + z * h, (h, x, z, r, c, u[:, 2 * n :])


def ahead(w, h, x):
    """Mean displacement per step until each of LEADS, relative to a typical one; rows x leads x 2."""
    return x[:, None, :] + (h @ w["out"] + w["bias"]).reshape(len(h), len(LEADS), 2)


# Training and predicting.


def loss_and_gradients(w, h, x, target, known):
    """Mean over the leads of the log of the mean squared error, its gradient by back-propagation through time, the last state.

    x: steps x rows x 2; target: steps x rows x leads x 2; known: steps x rows x leads, where the target counts.
    """
    memory, errors = [], np.empty_like(target)
    for t in range(len(x)):
        h, kept = cell(w, h, x[t])
        memory.append((h, kept))
        errors[t] = (ahead(w, h, x[t]) - target[t]) * known[t][..., None]
    loss, slope = log_loss(errors, known)
    gradients = {name: np.zeros_like(value) for name, value in w.items()}
    later = np.zeros_like(h)
    for t in reversed(range(len(x))):
        state, (before, now, z, r, c, u) = memory[t]
        of_out = slope[t].reshape(len(state), -1)
        gradients["out"] += state.T @ of_out
        gradients["bias"] += of_out.sum(axis=0)
        dh = later + of_out @ w["out"].T
        dc = dh * (1.0 - z) * (1.0 - c * c)
        dz, dr = dh * (before - c) * z * (1.0 - z), dc * u * r * (1.0 - r)
        da, du = np.hstack([dz, dr, dc]), np.hstack([dz, dr, dc * r])
        gradients["wx"] += now.T @ da
        gradients["b"] += da.sum(axis=0)
        gradients["wh"] += before.T @ du
        later = dh * z + du @ w["wh"].T
    return loss, gradients, h


def train(folder, step_s, updates, cells, seed):
    rng = np.random.default_rng(seed)
    weights, source = new_weights(cells, rng), batches(characters(folder, step_s), 80, 48, rng)

    def from_rest(w, x, target, known):
        return loss_and_gradients(w, np.zeros((x.shape[1], cells)), x, target, known)[:2]

    return fit(weights, source, from_rest, updates)


class GruPen(Pen):
    """The state of the cells, and the newest input."""

    def forget(self):
        self.h, self.x = np.zeros((1, len(self.w["wh"]))), np.zeros((1, 2))

    def take(self, x):
        self.x = x
        self.h, _ = cell(self.w, self.h, x)

    def ahead(self):
        return ahead(self.w, self.h, self.x)[0]


if __name__ == "__main__":
    main("a GRU", GruPen, train, cells=32)
