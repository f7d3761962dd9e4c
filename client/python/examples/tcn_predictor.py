"""A predictor of the pen: a temporal convolutional network in numpy. Trains, serves the lab in lock-step, or predicts live.

    foretrace lab leadtime --data unipen-ced --split train --export-targets points
    python tcn_predictor.py --train points --weights tcn-5ms.npz               # minutes on one core
    foretrace lab leadtime --data unipen-ced --models 'constant-velocity,external:python tcn_predictor.py --weights tcn-5ms.npz'
    python tcn_predictor.py --live 0 --weights tcn-10ms.npz                    # trained with --step-ms 10

The network is that of Bai, Kolter and Koltun (2018), "An Empirical Evaluation of Generic Convolutional and Recurrent Networks
for Sequence Modeling", arXiv:1803.01271: residual blocks of two causal convolutions each, dilated 1, 2, 4, 8, with rectified
linear units. Its weight normalisation and dropout are left out: the training data are turned and resized instead. It sees the
newest 61 steps. Needs numpy, and pen_network.py beside it; --live also the package foretrace. The same seed, points and
options give the same weights on any run.
"""

from pen_network import LEADS, TYPICAL, Pen, batches, characters, fit, log_loss, main, save

import numpy as np

#: Dilations of the residual blocks, and the taps of each convolution.
DILATIONS, TAPS = (1, 2, 4, 8), 3
#: Steps that an output depends on, its own included.
SEEN = 1 + 2 * (TAPS - 1) * sum(DILATIONS)


# The network. A block is relu(x' + relu(conv(relu(conv(x))))), where x' is x, in the first block brought to its width.


def new_weights(cells, rng):
    """Small random weights; the first prediction is that the pen goes on as it went."""

    def uniform(inputs, *shape):
        return rng.uniform(-1.0, 1.0, shape) * np.sqrt(1.0 / inputs)

    weights, inputs = {"wide": uniform(2, 2, cells)}, 2
    for block in range(len(DILATIONS)):
        for layer in "ab":
            weights[f"w{block}{layer}"] = uniform(TAPS * inputs, TAPS, inputs, cells)
            weights[f"b{block}{layer}"] = uniform(TAPS * inputs, cells)
            inputs = cells
    return weights | {"out": 0.1 * uniform(cells, cells, 2 * len(LEADS)), "bias": np.zeros(2 * len(LEADS))}


def convolved(x, w, b, dilation):
    """Causal: the output at t sees x[t], x[t - dilation] ...; before the first step all is zero. x: steps x rows x inputs."""
    out = np.broadcast_to(b, (*x.shape[:2], len(b))).copy()
    for back in range(min(TAPS, 1 + (len(x) - 1) // dilation)):
        late = back * dilation
        out[late:] += x[: len(x) - late] @ w[TAPS - 1 - back]
    return out


def convolved_back(x, w, dilation, of_out):
    """Gradients by x, w and b, from that by the output."""
    of_x, of_w = np.zeros_like(x), np.zeros_like(w)
    for back in range(min(TAPS, 1 + (len(x) - 1) // dilation)):
        late, tap = back * dilation, TAPS - 1 - back
        seen, slope = x[: len(x) - late], of_out[late:]
        of_x[: len(x) - late] += slope @ w[tap].T
        of_w[tap] = seen.reshape(-1, x.shape[2]).T @ slope.reshape(-1, slope.shape[2])
    return of_x, of_w, of_out.sum(axis=(0, 1))


def forward(w, x):
    """The output of the last block, and what the gradients need of each."""
    memory = []
    for block, dilation in enumerate(DILATIONS):
        first = np.maximum(convolved(x, w[f"w{block}a"], w[f"b{block}a"], dilation), 0.0)
        second = np.maximum(convolved(first, w[f"w{block}b"], w[f"b{block}b"], dilation), 0.0)
        out = np.maximum((x if block else x @ w["wide"]) + second, 0.0)
        memory.append((x, first, second, out))
        x = out
    return x, memory


def ahead(w, state, x):
    """Mean displacement per step until each of LEADS, relative to a typical one; ... x leads x 2."""
    return x[..., None, :] + (state @ w["out"] + w["bias"]).reshape(*state.shape[:-1], len(LEADS), 2)


# Training.


def loss_and_gradients(w, x, target, known):
    """Mean over the leads of the log of the mean squared error, and its gradient.

    x: steps x rows x 2; target: steps x rows x leads x 2; known: steps x rows x leads, where the target counts.
    """
    state, memory = forward(w, x)
    loss, slope = log_loss((ahead(w, state, x) - target) * known[..., None], known)
    of_out = slope.reshape(*state.shape[:2], -1)
    gradients = {"bias": of_out.sum(axis=(0, 1)), "out": state.reshape(-1, state.shape[2]).T @ of_out.reshape(-1, of_out.shape[2])}
    later = of_out @ w["out"].T
    for block in reversed(range(len(DILATIONS))):
        before, first, second, out = memory[block]
        later = later * (out > 0.0)
        of_first, gradients[f"w{block}b"], gradients[f"b{block}b"] = convolved_back(first, w[f"w{block}b"], DILATIONS[block], later * (second > 0.0))
        of_x, gradients[f"w{block}a"], gradients[f"b{block}a"] = convolved_back(before, w[f"w{block}a"], DILATIONS[block], of_first * (first > 0.0))
        if block:
            later = later + of_x
        else:
            gradients["wide"] = before.reshape(-1, 2).T @ later.reshape(-1, later.shape[2])
    return loss, gradients


def train(folder, step_s, updates, cells, seed):
    rng = np.random.default_rng(seed)
    weights, source = new_weights(cells, rng), batches(characters(folder, step_s), 100, 32, rng)
    return fit(weights, source, loss_and_gradients, updates)


# Predicting: each convolution keeps the inputs that its next outputs see, so that a step costs one output.


class TcnPen(Pen):
    """The newest inputs of every convolution, the oldest first, and the newest output."""

    def forget(self):
        self.past = {}
        for block, dilation in enumerate(DILATIONS):
            for layer in "ab":
                self.past[f"{block}{layer}"] = np.zeros(((TAPS - 1) * dilation + 1, self.w[f"w{block}{layer}"].shape[1]))
        self.x, self.state = np.zeros(2), np.zeros(len(self.w["out"]))

    def convolve(self, name, dilation, x):
        past = self.past[name]
        past[:-1] = past[1:]
        past[-1] = x
        weights = self.w[f"w{name}"]
        return np.maximum(past[::dilation].ravel() @ weights.reshape(-1, weights.shape[2]) + self.w[f"b{name}"], 0.0)

    def take(self, x):
        self.x = state = x[0]
        for block, dilation in enumerate(DILATIONS):
            second = self.convolve(f"{block}b", dilation, self.convolve(f"{block}a", dilation, state))
            state = np.maximum((state if block else state @ self.w["wide"]) + second, 0.0)
        self.state = state

    def ahead(self):
        return ahead(self.w, self.state, self.x)


if __name__ == "__main__":
    main("a temporal convolutional network", TcnPen, train, cells=24)
