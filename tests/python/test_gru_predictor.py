"""The example `gru_predictor.py`: its gradient, its training, and what it serves. Needs numpy, no daemon."""

import unittest

from network_example import HAS_NUMPY, NetworkExample


@unittest.skipUnless(HAS_NUMPY, "numpy is not installed")
class Gru(NetworkExample, unittest.TestCase):
    name = "gru_predictor"

    def loss_of(self, example, rng):
        """From random states of the cells, or with no generator from rest."""
        import numpy as np

        def loss(w, x, target, known):
            shape = (x.shape[1], len(w["wh"]))
            state = np.zeros(shape) if rng is None else np.random.default_rng(5).normal(size=shape)
            return example.loss_and_gradients(w, state, x, target, known)[:2]

        return loss

    def pen_of(self, example, file):
        return example.GruPen(file)


if __name__ == "__main__":
    unittest.main()
