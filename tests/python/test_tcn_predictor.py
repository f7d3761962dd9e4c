"""The example `tcn_predictor.py`: its gradient, its training, what it serves, and what it must not see. Needs numpy, no daemon."""

import unittest

from network_example import HAS_NUMPY, NetworkExample


@unittest.skipUnless(HAS_NUMPY, "numpy is not installed")
class Tcn(NetworkExample, unittest.TestCase):
    name = "tcn_predictor"

    def loss_of(self, example, rng):
        return example.loss_and_gradients

    def pen_of(self, example, file):
        return example.TcnPen(file)

    def test_an_output_sees_the_newest_61_steps_and_nothing_ahead(self):
        import numpy as np

        tcn, rng = self.example(), np.random.default_rng(2)
        self.assertEqual(tcn.SEEN, 61)
        weights = tcn.new_weights(6, rng)
        x = rng.normal(size=(90, 1, 2))
        before, _ = tcn.forward(weights, x)
        changed = x.copy()
        changed[20] += 1.0
        after, _ = tcn.forward(weights, changed)
        seen = np.flatnonzero(np.abs(after - before).max(axis=(1, 2)) > 0.0)
        self.assertEqual(seen[0], 20)
        self.assertLessEqual(seen[-1], 20 + tcn.SEEN - 1)
        self.assertGreater(seen[-1], 20 + tcn.SEEN // 2)

    def test_step_by_step_it_predicts_what_the_whole_stroke_gives(self):
        import numpy as np

        tcn, rng = self.example(), np.random.default_rng(4)
        weights = tcn.new_weights(6, rng)
        file = self.folder / "random.npz"
        tcn.save(file, 0.005, weights)
        pen = tcn.TcnPen(file)
        x = np.clip(rng.normal(size=(100, 1, 2)), -2.5, 2.5)
        state, _ = tcn.forward(weights, x)
        whole = tcn.ahead(weights, state, x)
        for stroke in range(2):
            pen.observe(0.0, 0.0, 1.0, False)
            for step in range(len(x)):
                dx, dy = tcn.TYPICAL * x[step, 0]
                pen.observe(dx, dy, 1.0, True)
                self.assertLess(np.abs(pen.ahead() - whole[step, 0]).max(), 1e-12, f"stroke {stroke}, step {step}")


if __name__ == "__main__":
    unittest.main()
