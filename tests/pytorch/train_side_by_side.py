#!/usr/bin/env python3
"""Trains the paper's LSTM in PyTorch beside `foretrace lab train --bench`: same work, same numbers, both times.

    python3 tests/pytorch/train_side_by_side.py [--foretrace target/release/foretrace] [--data DIR] [--rounds 5]

One thread each, batches of 16, zero padding counted in the loss, Adam 1e-3, on the same sequences in the same order. The
two take turns, so that both see the same machine; times are wall clock per real step (padding is work, but no steps).
Exit code: 0 all agrees, 1 a difference, 77 skipped because PyTorch is missing.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

try:
    import torch
except ImportError:
    print("SKIPPED: PyTorch is not installed for this Python; nothing was compared", file=sys.stderr)
    sys.exit(77)

NAMES = ["lstm.weight_ih_l0", "lstm.weight_hh_l0", "lstm.bias_ih_l0", "lstm.bias_hh_l0", "out.weight", "out.bias"]


class Network(torch.nn.Module):
    def __init__(self, cells: int):
        super().__init__()
        self.lstm = torch.nn.LSTM(2, cells, batch_first=True)
        self.out = torch.nn.Linear(cells, 2)

    def forward(self, x):
        return self.out(self.lstm(x)[0])


def load(network: Network, flat: list) -> None:
    at, state = 0, network.state_dict()
    for name in NAMES:
        count = state[name].numel()
        state[name].copy_(torch.tensor(flat[at : at + count]).view_as(state[name]))
        at += count
    assert at == len(flat), (at, len(flat))


def flat(tensors: dict) -> torch.Tensor:
    return torch.cat([tensors[name].detach().reshape(-1) for name in NAMES])


def epoch(network: Network, optimiser, batches: list, first_gradient: list) -> list:
    losses = []
    for batch in batches:
        padded = torch.nn.utils.rnn.pad_sequence(batch, batch_first=True)
        optimiser.zero_grad()
        loss = torch.nn.functional.mse_loss(network(padded[:, :-1]), padded[:, 1:])
        loss.backward()
        if not first_gradient:
            first_gradient.append(flat({n: p.grad for n, p in network.named_parameters()}).clone())
        optimiser.step()
        losses.append(loss.item())
    return losses


def largest_difference(ours, theirs) -> float:
    ours, theirs = torch.as_tensor(ours, dtype=torch.float64), torch.as_tensor(theirs, dtype=torch.float64)
    return float((ours - theirs).abs().max() / theirs.abs().max())


def main() -> int:
    root = pathlib.Path(__file__).resolve().parents[2]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--foretrace", default=str(root / "target/release/foretrace"))
    parser.add_argument("--data", help="data-set folder; made-up strokes without it")
    parser.add_argument("--model", default="lstm10", choices=["lstm10", "lstm32", "lstm64"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", help="also write the numbers here")
    options = parser.parse_args()
    if not pathlib.Path(options.foretrace).is_file():
        print(f"{options.foretrace} is missing; build it with: cargo build --release -p foretrace", file=sys.stderr)
        return 1
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        exchange = pathlib.Path(folder, "exchange.json")
        command = [options.foretrace, "lab", "train", "--bench", "--model", options.model, "--epochs", "3"]
        command += ["--exchange", str(exchange)] + (["--data", options.data] if options.data else [])

        def ours() -> dict:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            return json.loads(exchange.read_text())

        work = ours()
        sequences = [torch.tensor(s) for s in work["sequences"]]
        batches = [sequences[i : i + work["batch"]] for i in range(0, len(sequences), work["batch"])]
        network = Network(work["cells"])
        load(network, work["start"])
        optimiser = torch.optim.Adam(network.parameters(), lr=work["rate"])
        gradient: list = []
        losses = epoch(network, optimiser, batches, gradient)
        differences = {
            "first loss": (abs(losses[0] - work["losses"][0]) / abs(losses[0]), 1e-5),
            "first gradient": (largest_difference(work["first_gradient"], gradient[0]), 1e-5),
            "losses of an epoch": (largest_difference(work["losses"], losses), 1e-3),
            "parameters after it": (largest_difference(work["after_one_epoch"], flat(network.state_dict())), 1e-2),
        }
        times: dict = {"foretrace": [], "pytorch": []}
        for _ in range(options.rounds):
            times["foretrace"] += ours()["us_per_step"]
            begin = time.perf_counter()
            epoch(network, optimiser, batches, gradient)
            times["pytorch"].append((time.perf_counter() - begin) * 1e6 / work["steps"])
    median = {side: statistics.median(values) for side, values in times.items()}
    least = {side: min(values) for side, values in times.items()}
    print(f"{options.model}, batches of {work['batch']}, {len(sequences)} sequences, {work['steps']} steps per epoch, one thread each")
    for side, name in [("foretrace", "foretrace"), ("pytorch", f"PyTorch {torch.__version__}")]:
        print(f"{name:<24} {median[side]:8.3f} us per step (median), {least[side]:.3f} (least)")
    print(f"foretrace is {median['pytorch'] / median['foretrace']:.1f} times faster (medians), {least['pytorch'] / least['foretrace']:.1f} (least)")
    wrong = False
    for what, (difference, limit) in differences.items():
        bad = not difference <= limit
        wrong |= bad
        print(f"{what:<24} differ by {difference:.2e} of the largest; at most {limit:.0e} is rounding{'  WRONG' if bad else ''}")
    if options.json:
        numbers = {"median": median, "least": least, "times": times, "differences": {k: d for k, (d, _) in differences.items()}}
        pathlib.Path(options.json).write_text(json.dumps(numbers, indent=1) + "\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
