"""What the tests of the examples of networks share: the gradient, the training, and what is served. Needs numpy, no daemon."""

import importlib
import importlib.util
import json
import math
import pathlib
import subprocess
import sys
import tempfile

HAS_NUMPY = importlib.util.find_spec("numpy") is not None
EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/python/examples"


def point(number, turn):
    angle = 0.07 * number
    return 60.0 * math.sin(angle) + 0.4 * number, 45.0 * math.sin(2.0 * angle + turn)


def written(folder, characters=6, points=120):
    """Points of a made-up hand, as `--export-targets` writes them, the pen lifted once."""
    with open(pathlib.Path(folder) / "made-points.csv", "w", encoding="utf-8") as out:
        out.write("file,segment,t,t_s,x,y,stroke_start\n")
        for character in range(characters):
            for number in range(points):
                x, y = point(number, 0.5 * character)
                away = 150.0 if number >= 70 else 0.0
                out.write(f"w0.dat,{character},{number},{number * 0.005},{x + away:.0f},{y:.0f},{int(number in (0, 70))}\n")


class NetworkExample:
    """Tests of the example `name`; a test case says how to make small weights, and what their loss and gradients are."""

    def example(self):
        # The examples import what they share from beside them.
        if str(EXAMPLES) not in sys.path:
            sys.path.insert(0, str(EXAMPLES))
        return importlib.import_module(self.name)

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        written(self.folder)

    def run_it(self, *arguments, given=""):
        return subprocess.run([sys.executable, str(EXAMPLES / f"{self.name}.py"), *arguments], input=given, capture_output=True, text=True, timeout=120)

    def trained(self, name, *more):
        file = self.folder / name
        done = self.run_it("--train", str(self.folder), "--weights", str(file), "--updates", "120", "--cells", "8", *more)
        self.assertEqual(done.returncode, 0, done.stderr)
        return file

    def test_the_gradient_is_that_of_finite_differences(self):
        import numpy as np

        example, rng = self.example(), np.random.default_rng(3)
        weights = example.new_weights(5, rng)
        x, target, known = next(example.batches(example.characters(self.folder, 0.005), 24, 4, rng))
        self.assertTrue(0.3 < known.mean() < 1.0, known.mean())
        loss = self.loss_of(example, rng)
        _, gradients = loss(weights, x, target, known)
        for name, gradient in gradients.items():
            places = [np.unravel_index(place, gradient.shape) for place in rng.choice(gradient.size, min(12, gradient.size), replace=False)]
            for place in places:
                kept, step = weights[name][place], 1e-5
                losses = []
                for change in (step, -step):
                    weights[name][place] = kept + change
                    losses.append(loss(weights, x, target, known)[0])
                weights[name][place] = kept
                # The central difference has an error of about step² and of the loss's last digit over the step.
                self.assertAlmostEqual((losses[0] - losses[1]) / (2.0 * step), gradient[place], delta=1e-7 + 1e-6 * abs(gradient[place]), msg=f"{name}{place}")

    def test_targets_behind_a_lift_do_not_count(self):
        import numpy as np

        example = self.example()
        for step_s, lift in ((0.005, 69), (0.010, 34)):
            for v, lifted in example.characters(self.folder, step_s)[:2]:
                self.assertEqual(list(np.flatnonzero(lifted)), [lift])
                self.assertGreater(v[lift][0], 140.0)
        _, target, known = next(example.batches(example.characters(self.folder, 0.005), 60, 16, np.random.default_rng(1)))
        self.assertLess(np.abs(target[known > 0]).max(), 8.0)

    def test_it_learns_and_a_seed_gives_the_same_file(self):
        import numpy as np

        first, again, other = self.trained("a.npz"), self.trained("b.npz"), self.trained("c.npz", "--seed", "2")
        self.assertEqual(first.read_bytes(), again.read_bytes())
        self.assertNotEqual(first.read_bytes(), other.read_bytes())
        example, rng = self.example(), np.random.default_rng(7)
        x, target, known = next(example.batches(example.characters(self.folder, 0.005), 60, 32, rng))
        loss = self.loss_of(example, None)
        losses = [loss(w, x, target, known)[0] for w in (example.new_weights(8, np.random.default_rng(1)), self.pen_of(example, first).w)]
        self.assertLess(losses[1], losses[0] - 0.4, losses)
        refused = self.run_it("--train", str(self.folder), "--weights", str(self.folder / "d.npz"), "--step-ms", "7")
        self.assertIn("no character has this step", refused.stderr)

    def test_what_it_serves_has_the_form_that_the_lab_wants(self):
        file = self.trained("net.npz")
        lines = [{"protocol": "foretrace-predictor-1", "task": "table", "unit": "raw", "step_s": 0.005}]
        step = {"scale": 0.6, "longest": None, "contact": True, "wanted": 0}
        lines.append({"step": {**step, "index": 0, "t_s": 0.0, "x": 0.0, "y": 0.0, "dx": 0.0, "dy": 0.0, "motion": "start"}})
        for number in range(1, 51):
            (x, y), (x0, y0) = point(number, 0.0), point(number - 1, 0.0)
            wanted = (0, 10, 64)[number % 3]
            lines.append({"step": {**step, "index": number, "t_s": 0.005 * number, "x": x, "y": y, "dx": x - x0, "dy": y - y0, "motion": "continues", "wanted": wanted}})
        served = self.run_it("--weights", str(file), given="".join(json.dumps(line) + "\n" for line in lines))
        self.assertEqual(served.returncode, 0, served.stderr)
        answers = [json.loads(line) for line in served.stdout.splitlines()]
        self.assertEqual(len(answers), len(lines))
        for line, answer in zip(lines, answers):
            asked = line.get("step", step)
            self.assertEqual(set(answer), {"positions"} if asked["wanted"] else set())
            path = answer.get("positions", [])
            self.assertEqual(len(path), asked["wanted"])
            for before, after in zip([[asked.get("x"), asked.get("y")], *path], path):
                self.assertLess(math.dist(before, after), 60.0)
        # Beyond its farthest lead the pen rests.
        self.assertEqual(answers[-1]["positions"][40:], [answers[-1]["positions"][39]] * 24)
        other = self.run_it("--weights", str(file), given=json.dumps({**lines[0], "step_s": 0.01}) + "\n")
        self.assertNotEqual(other.returncode, 0)
        self.assertIn("train with --step-ms 10", other.stderr)
