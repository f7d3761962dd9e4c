"""The examples of networks beside a daemon: `gru_predictor.py --live`. Needs numpy."""

import pathlib
import subprocess
import sys
import unittest
from unittest import mock

import foretrace
from foretrace.messages import PenMotion, PenStep, PreviewRefusal
from network_example import EXAMPLES, HAS_NUMPY, written
from world import Hand, World, until

GRU = str(EXAMPLES / "gru_predictor.py")


@unittest.skipUnless(HAS_NUMPY, "numpy is not installed")
class Live(World):
    def weights(self, step_ms):
        points, file = pathlib.Path(self.folder, "points"), pathlib.Path(self.folder, "gru.npz")
        points.mkdir()
        written(points)
        options = ["--train", str(points), "--weights", str(file), "--step-ms", str(step_ms), "--updates", "20", "--cells", "8"]
        done = subprocess.run([sys.executable, GRU, *options], capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        return file

    def live(self, weights):
        command = [sys.executable, GRU, "--live", "0", "--weights", str(weights)]
        child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        return child

    def test_it_predicts_for_a_daemon_in_time_and_in_its_form(self):
        file = self.weights(10)
        self.daemon()
        child = self.live(file)
        with foretrace.attach() as ft:
            hand = Hand(ft)

            def state():
                self.assertIsNone(child.poll(), child.poll() is not None and child.communicate())
                return ft.status().external

            until("a hundred steps had a preview in time", lambda: state().hits >= 100, timeout=60.0)
            told = state()
            self.assertEqual(told.refused[PreviewRefusal.MALFORMED - 1], 0, list(told.refused))
            self.assertGreater(told.latency.p50_ns, 0)
            hand.end()
            self.assertIsNone(hand.error)

    def test_weights_for_other_steps_are_refused_with_the_option_that_makes_them(self):
        file = self.weights(5)
        self.daemon()
        child = self.live(file)
        with foretrace.attach() as ft:
            hand = Hand(ft)
            _, error = child.communicate(timeout=60.0)
            hand.end()
        self.assertEqual(child.returncode, 1)
        self.assertIn("train with --step-ms 10", error)

    def test_a_lost_step_is_a_new_beginning(self):
        # The examples import what they share from beside them.
        with mock.patch.object(sys, "path", [str(EXAMPLES), *sys.path]):
            import pen_network

        pen, predictor = mock.MagicMock(), mock.MagicMock()
        # The first belongs to nothing; 3 and 4 are lost; at 8 the hand itself begins anew.
        numbers, fresh = [1, 2, 5, 6, 7, 8, 9], 8
        steps = [PenStep(index=n, motion=PenMotion.START if n == fresh else PenMotion.CONTINUES) for n in numbers]
        predictor.__enter__.return_value.__iter__.return_value = iter(steps)
        with mock.patch("foretrace.attach") as attach:
            attach.return_value.__enter__.return_value.predictor_interface.return_value = predictor
            pen_network.live(pen, 0)
        told = [call.args[3] for call in pen.observe.call_args_list]
        self.assertEqual(told, [False, True, False, True, True, False, True])
        self.assertEqual(predictor.__enter__.return_value.send.call_count, len(numbers))


if __name__ == "__main__":
    unittest.main()
