"""The law from Python, number by number against the Rust calls (`examples/law_bits.rs`)."""

import math
import os
import random
import re
import struct
import subprocess
import unittest

import foretrace
from foretrace import Chain, Follower, Guard, Invalid, Joints, Limits, Problem
from foretrace.law import Pen
from support import ROOT, Scratch, numpy

WORDS = {
    "fresh plan": "freshplan", "previous plan": "previousplan", "moving home": "homing", None: "none",
    "dead-man": "enablelost", "joint states stale": "jointstatelost",
}
VERDICTS = ["taken", "malformed", "non-finite", "ahead", "late", "repeated", "other stroke", "wild"]
REASONS = ["not finite", "position", "velocity", "acceleration", "jerk", "stamp", "gap"]


def bits(numbers):
    return [struct.pack(">d", number).hex() for number in numbers]


def maybe(number):
    return ["-"] if number is None else bits([number])


def judged(orders):
    """The answers of the Rust side, as lists of words."""
    judge = os.environ.get("FORETRACE_LAW_BITS")
    if not judge:
        raise unittest.SkipTest("the example law_bits is not built; give it as FORETRACE_LAW_BITS (tests/run.sh builds it)")
    text = "\n".join(" ".join(map(str, order)) for order in orders) + "\n"
    done = subprocess.run([judge], input=text, capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        raise AssertionError(f"the Rust side failed: {done.stderr}")
    return [line.split() for line in done.stdout.splitlines()]


def decided(step):
    """A step as the Rust side prints it; words of the law are checked apart."""
    command = step.command
    said = ["-"]
    if command is not None:
        said = [str(command.stamp_ns), str(command.valid_until_ns), str(int(command.enabled))]
        said += bits(command.q) + bits(command.qd)
    said.append(str(int(step.begins)))
    said.append({None: "-", True: "yes", False: "no"}[step.accepted])
    said += [step.predictor, str(step.weights_version)]
    said += bits([step.trust, step.trust_target, step.governor]) + bits(step.pen_m)
    said += [str(int(step.pen_contact)), str(step.pen_counters["accepted"])]
    said += maybe(step.predictor_error_m) + maybe(step.predictor_band_m) + [str(step.dead_time_ns)]
    said += maybe(step.lag and step.lag["lag_s"]) + maybe(step.arm_speed_share)
    said += bits(step.reference_m) + bits(step.tool_m)
    said += bits(number for axis in step.setpoint for number in axis)
    said += bits(number for point in step.preview_m for number in point)
    said += bits([step.ik["kkt_residual"], step.ik["damping_m2"], step.ik["singularity_m"]])
    said += bits(axis["kkt_residual"] for axis in step.axes) + [str(step.grid_steps)]
    said += [str(step.pen_sequence), str(step.preview_steps)]
    for closed in step.pen_steps:
        said += [str(closed.index), str(closed.contact)] + bits([closed.x_m, closed.y_m])
        said += bits([closed.dx_m, closed.dy_m, closed.scale_m, closed.longest_m])
    if step.external is not None:
        told = step.external
        said += bits([told["weight"], told["evidence"]])
        said += [str(-1 if told["age"] is None else told["age"])]
        said += [str(-1 if told["verdict"] is None else VERDICTS.index(told["verdict"]))]
    return said


class Session:
    """Runs a follower, and notes the same orders for the Rust side."""

    def __init__(self, learn, changes):
        self.follower = Follower("ur5", changes, learn=learn)
        pairs = [f"{key}={value}" for key, value in changes.items()]
        self.orders = [["follower", int(learn), "ur5", len(pairs), *pairs]]
        self.steps = []

    def step(self, now, pen, joints, enable, request, preview=None, **rest):
        order = ["step", now, len(pen)]
        for stamp, x, y, contact, sequence in pen:
            order += [stamp, *bits([x, y]), int(contact), sequence]
        order.append(int(joints is not None))
        if joints is not None:
            order += [joints.stamp_ns, *bits(joints.q), *bits(joints.qd), int(joints.motion_allowed)]
            order += ["none"] if joints.effort is None else [joints.effort_unit, *bits(joints.effort)]
        order.append(int(enable is not None))
        order += [] if enable is None else [enable[0], int(enable[1])]
        if isinstance(request, tuple):
            word, value = request
            order += ["auto"] if value == "auto" else [word, *(bits([value]) if word == "trust" else [value])]
        else:
            order.append({None: "none", "move home": "home"}.get(request, request))
        order += [int(rest.get("halt", False)), int(rest.get("unsent", False))]
        order += [rest.get("max_iterations", 100), int(rest.get("shed", False)), int(preview is not None)]
        if preview is not None:
            base, positions, radii = preview
            order += [base, len(positions), len(radii or ()), *bits(n for xy in positions for n in xy), *bits(radii or ())]
        self.orders.append(order)
        self.steps.append(self.follower.step(now, pen, joints, request, enable=enable, preview=preview, **rest))
        return self.steps[-1]


def hand(rng, now, t):
    """A hand that draws, lifts, rests, jumps and now and then sends rubbish."""
    x = 0.03 * math.sin(2.1 * t) + 0.01 * math.sin(9.0 * t + 1.0)
    y = 0.02 * math.cos(1.7 * t) + 0.008 * math.sin(12.0 * t)
    if 3.0 < t < 3.6:
        return []
    sample = (now - rng.randrange(0, 1_900_000), x + rng.gauss(0, 2e-5), y, math.sin(t) > -0.7, now % 1_000_003)
    if rng.random() < 0.01:
        return [(now, rng.choice([math.nan, 5.0, -math.inf]), y, True, 0)]
    return [sample] * rng.choice([0, 1, 1, 1, 2])


def rest_of(rng, tick):
    """The rarer arguments of a tick."""
    rest = {"halt": tick == 500, "unsent": rng.random() < 0.02, "shed": rng.random() < 0.02}
    return rest | {"max_iterations": rng.choice([100] * 20 + [0, 1, 5])}


def foreseen(rng, step):
    """What a predictor of constant velocity says after a tick, and now and then rubbish."""
    if not step.pen_steps:
        return None
    last, wrong = step.pen_steps[-1], rng.random()
    count = rng.choice([last.wanted, 64])
    positions = [(last.x_m + k * last.dx_m, last.y_m + k * last.dy_m) for k in range(1, count + 1)]
    radii = [1e-4 * k for k in range(1, count + 1)] if rng.random() < 0.5 else None
    if wrong < 0.02:
        positions[rng.randrange(count)] = (math.nan, 0.0)
    elif wrong < 0.04:
        positions, radii = positions[:2], None
    elif wrong < 0.06:
        positions[3] = (0.3, 0.3)
    base = last.index + (rng.choice([1, -1, -30]) if 0.06 < wrong < 0.12 else 0)
    return max(base, 0), positions, radii


class FollowerBits(unittest.TestCase):
    def compare(self, seed, learn, changes, ticks, foresee=None):
        rng = random.Random(seed)
        session = Session(learn, changes)
        follower, period = session.follower, session.follower.period_ns
        q, qd, modes = list(follower.home), [0.0] * 6, set()
        requests = {3: "arm", 800: "arm", 900: ("trust", 0.4), 1000: ("trust", "auto"), 1200: ("predictor", "constant-velocity")}
        requests |= {1500: ("trust", 3.0), 1700: "stop", 2000: "arm", 2300: "disarm", 2600: "move home"}
        preview = None
        for tick in range(1, ticks):
            now = 1_000_000_000 + tick * period
            effort = [rng.gauss(0, 0.2) for _ in range(6)] if rng.random() < 0.7 else None
            unit = rng.choice(["Nm", "A", "share"])
            joints = Joints(now, q, qd, effort=effort, effort_unit=unit) if rng.random() < 0.98 else None
            enable = (now, False) if tick < 2200 else None
            pen, request = hand(rng, now, tick * period * 1e-9), requests.get(tick)
            step = session.step(now, pen, joints, enable, request, preview, **rest_of(rng, tick))
            preview = foresee and foresee(rng, step)
            modes.add(step.mode)
            if step.command is not None:
                q, qd = step.command.q, step.command.qd
        answers = judged(session.orders)
        self.assertEqual(len(answers), len(session.steps))
        for tick, (step, answer) in enumerate(zip(session.steps, answers)):
            self.assertEqual(decided(step), answer[1:], f"tick {tick}")
            mode, rung, _ = answer[0].split("/")
            self.assertEqual((WORDS.get(step.mode, step.mode), WORDS.get(step.rung, step.rung)), (mode, rung))
            self.assertEqual(step.stop_reason is None, answer[0].endswith("/none"))
        self.assertIn("following", modes)
        return session, modes

    def test_every_number_of_every_tick_is_that_of_the_rust_call(self):
        session, modes = self.compare(1, True, {}, 3200)
        self.assertGreaterEqual(modes, {"idle", "following", "holding", "stopped", "moving home"})
        self.assertTrue(any(step.weights_version > 0 for step in session.steps), "the learner promoted nothing")
        self.assertTrue(any(step.refusal for step in session.steps))
        self.assertTrue(any(step.pen_refused for step in session.steps))
        self.assertTrue(any(len(step.preview_m) == 10 for step in session.steps))

    def test_other_settings_and_horizons_too_and_without_a_learner(self):
        for horizon, kind in ((10, "dybm"), (20, "hold")):
            with self.subTest(horizon=horizon):
                session, _ = self.compare(horizon, False, {"mpc.horizon": horizon, "predictor.kind": kind}, 900)
                self.assertEqual(session.follower.horizon, horizon)
                self.assertEqual({step.weights_version for step in session.steps}, {0})

    def test_a_predictor_of_ones_own_earns_its_part_bit_for_bit(self):
        changes = {"predictor.kind": "external", "predictor.external.fallback": "hold"}
        session, _ = self.compare(7, False, changes, 2200, foreseen)
        told = [step.external for step in session.steps]
        self.assertEqual({step.predictor for step in session.steps[:1000]}, {"external"})
        self.assertGreater(max(one["weight"] for one in told if one), 0.9)
        verdicts = {one["verdict"] for one in told if one}
        self.assertGreaterEqual(verdicts, {None, "taken", "malformed", "non-finite", "ahead", "late", "wild"})
        self.assertEqual({one is None for one in told[:1000]}, {False})
        wanted = {closed.wanted for step in session.steps for closed in step.pen_steps}
        self.assertTrue(all(wanted_ >= 1 for wanted_ in wanted))

    def test_the_learner_makes_a_difference(self):
        def alphas(learn):
            session, rng = Session(learn, {"predictor.kind": "dybm"}), random.Random(5)
            for tick in range(1, 2500):
                now = 1_000_000_000 + tick * session.follower.period_ns
                joints = Joints(now, session.follower.home, [0.0] * 6)
                session.step(now, hand(rng, now, tick * 0.002), joints, None, None)
            return [step.predictor_error_m for step in session.steps]

        self.assertNotEqual(alphas(True), alphas(False))


class Build(unittest.TestCase):
    def test_the_package_is_built_of_the_same_versions_as_the_program(self):
        def versions(*folder):
            with open(os.path.join(ROOT, *folder, "Cargo.lock"), encoding="utf-8") as file:
                return re.findall(r'^name = "(.+)"\nversion = "(.+)"$', file.read(), re.MULTILINE)

        program, package = versions(), versions("client", "python")
        shared = {name for name, _ in program} & {name for name, _ in package}
        self.assertIn("nalgebra", shared)
        other = [found for found in package if found[0] in shared and found not in program]
        self.assertEqual(other, [], "take these versions of the root's Cargo.lock: cargo update --precise")


class FollowerUse(Scratch):
    def test_settings_are_a_preset_a_file_or_a_dict(self):
        path = self.write("own.toml", 'preset = "ur5"\n[predictor]\nkind = "hold"\n')
        for settings, changes in [
            (path, None), ({"preset": "ur5", "predictor.kind": "hold"}, None),
            ({"preset": "ur5", "predictor": {"kind": "hold"}}, None), ("ur5", {"predictor": {"kind": "hold"}}),
        ]:
            follower = Follower(settings, changes)
            self.assertEqual(follower.step(5).predictor, "hold")
            self.assertEqual(follower.period_ns, 2_000_000)
        self.assertEqual(Follower("ur5e").settings_name, "preset ur5e")

    def test_wrong_settings_name_everything_that_is_wrong(self):
        wrong = {"preset": "ur5", "loop.rate_hz": 77, "mpc": {"horizn": 3}}
        with self.assertRaises(Invalid) as caught:
            Follower(wrong)
        for part in ("rate_hz", "77", "horizn", "horizon"):
            self.assertIn(part, str(caught.exception))
        for settings, why in [
            ("ur6", "ur5"), (self.path("none.toml"), "none.toml"), ({"loop.rate_hz": 500}, "plane|missing"),
            (7, "legal: a preset"), ({"preset": 5}, "legal"), ({"preset": "ur5", "x": object()}, "legal: bool"),
        ]:
            with self.assertRaisesRegex(Invalid, why):
                Follower(settings)

    def test_arguments_that_are_none_are_refused_and_change_nothing(self):
        follower = Follower("ur5")
        home = follower.home
        for arguments, why in [
            ({"joints": Joints(1, home[:5], home)}, "joints.q has 5 entries; the arm has 6"),
            ({"joints": Joints(1, home, ["a"] * 6)}, "joints.qd"),
            ({"joints": Joints(-1, home, home)}, "legal: 0 to 2"),
            ({"joints": Joints(1, home, home, effort=[0.0] * 6, effort_unit="lbf")}, "effort_unit"),
            ({"pen": [(1.5, 0, 0, True)]}, "whole nanoseconds"),
            ({"pen": [(1, 0)]}, "a pen reading is"),
            ({"pen": [(1, 0.0, 0.0, True)] * 5000}, "5000 pen samples"),
            ({"request": "jump"}, "'arm', 'disarm'"),
            ({"request": ("trust", "much")}, "legal"),
            ({"request": ("predictor", "ours")}, "is called mixture"),
            ({"request": 5}, "legal"),
            ({"preview": 5}, "preview is 5; legal: a step"),
            ({"preview": (1, [(0.0,)])}, "legal: a step"),
            ({"preview": (1, [(0.0, "a")])}, "legal: a step"),
            ({"preview": (1.5, [(0.0, 0.0)])}, "preview's step is 1.5; legal: whole numbers"),
            ({"preview": (-1, [(0.0, 0.0)])}, "preview's step is -1; legal: 0 to"),
            ({"preview": (1, [(0.0, 0.0)] * 65)}, "65 positions; legal: at most 64"),
            ({"preview": (1, [(0.0, 0.0)] * 9, [0.1] * 65)}, "65 radii; legal: at most 64"),
            ({"joints": Joints(1, [10**400] * 6, home)}, "joints.q is"), ({"joints": Joints(1, [10**5000] * 6, home)}, "joints.q is"),
            ({"joints": Joints(10**5000, home, home)}, "stamp_ns is a int of thousands of digits; legal: 0 to"),
            ({"pen": [(1, 10**400, 0.0, True)]}, "a pen reading is"),
            ({"pen": [(1, 0.0, 0.0, True, -1)]}, "sequence is -1; legal: 0 to"),
            ({"max_iterations": -1}, "max_iterations"),
        ]:
            with self.assertRaisesRegex(Invalid, why):
                follower.step(10, **arguments)
        self.assertEqual(follower.step(10).pen_counters["received"], 0)

    def test_a_loop_of_a_few_lines_follows_a_recorded_hand(self):
        follower = Follower("ur5")
        pen = foretrace.datasets.path("glyphs:hi", "ur5").readings(begin_ns=1_500_000_000)
        q, qd, at, errors = follower.home, [0.0] * 6, 0, []
        for tick in range(1, 2500):
            now = 1_000_000_000 + tick * follower.period_ns
            arrived = at
            while arrived < len(pen) and pen[arrived][0] <= now:
                arrived += 1
            step = follower.step(now, pen[at:arrived], Joints(now, q, qd), "arm" if tick == 2 else None)
            at = arrived
            if step.command is not None:
                q, qd = step.command.q, step.command.qd
            if step.mode == "following" and step.pen_contact and step.tool_m[2] < 0.002:
                errors.append(math.hypot(*(tool - pen for tool, pen in zip(step.tool_m, step.pen_m))))
        self.assertGreater(len(errors), 300)
        self.assertLess(sorted(errors)[len(errors) // 2], 5e-3)
        tool = follower.plane_from_base(follower.chain.forward(q).position)
        self.assertLess(max(abs(a - b) for a, b in zip(tool, step.tool_m)), 1e-9)

    def test_a_halt_stops_without_a_request(self):
        follower, now = Follower("ur5"), 0
        for tick in range(1, 200):
            now = 1_000_000_000 + tick * follower.period_ns
            request, halt = ("arm" if tick == 2 else None), tick == 100
            step = follower.step(now, joints=Joints(now, follower.home, [0.0] * 6), request=request, halt=halt)
            self.assertEqual(step.mode, "idle" if tick < 2 else "armed" if tick < 100 else "stopped", tick)
        self.assertEqual((step.stop_reason, step.stop["joint"]), ("requested", None))


class GuardBits(unittest.TestCase):
    def orders(self, joints, seed):
        rng = random.Random(seed)
        spread = lambda low, high: [rng.uniform(low, high) for _ in range(joints)]
        low, high = spread(-3.0, -0.5), spread(0.4, 3.0)
        velocity, acceleration = spread(0.5, 3.0), spread(5.0, 40.0)
        jerk = spread(100.0, 4000.0) if seed % 2 else None
        braking, hold = [0.7 * a for a in acceleration], rng.choice([0.0, 0.01, 0.05])
        limits = Limits(list(zip(low, high)), velocity, acceleration, jerk, hold_s=hold, braking=braking)
        head = ["guard", joints, *bits(low + high + velocity + acceleration), int(jerk is not None)]
        orders = [head + bits((jerk or []) + [hold] + braking)]
        guard, verdicts, at = Guard(limits), [], 0
        guard.begin([0.0] * joints, 0)
        for _ in range(600):
            at += rng.choice([1_000_000, 2_000_000, 2_000_000, 8_000_000, 200_000_000, -3_000_000, 0])
            at = max(at, 0)
            order = rng.choice(["clamp", "clamp", "clamp", "stop", "silence"])
            if order == "clamp":
                q = [rng.choice([rng.uniform(-4, 4), 0.1 * rng.gauss(0, 1), math.nan, math.inf, 1e300]) for _ in range(joints)]
                q = [0.01 * rng.gauss(0, 1) for _ in range(joints)] if rng.random() < 0.6 else q
                verdicts.append(guard.clamp(q, at))
                orders.append(["clamp", at, *bits(q)])
            elif order == "stop":
                verdicts.append(guard.stop(at))
                orders.append(["stop", at])
            else:
                at = max([at, *(verdict.stamp_ns for verdict in verdicts[-1:])])
                verdicts.append(guard.after_silence(at))
                orders.append(["silence", at])
        return orders + [["end"]], verdicts, limits

    def test_every_verdict_is_that_of_the_rust_call(self):
        seen = set()
        for joints in (2, 6, 7):
            for seed in range(4):
                orders, verdicts, limits = self.orders(joints, seed)
                answers = judged(orders)
                self.assertEqual(len(answers), len(verdicts))
                for verdict, answer in zip(verdicts, answers):
                    altered = sum(1 << joint for joint in verdict.altered)
                    reasons = sum(1 << REASONS.index(word) for word in verdict.reasons)
                    seen.update(verdict.reasons)
                    own = [str(verdict.stamp_ns), str(altered), str(reasons)]
                    own += bits(verdict.q) + bits(verdict.qd) + bits(verdict.qdd)
                    self.assertEqual(own, answer)
                    for q, (low, high) in zip(verdict.q, limits.position):
                        self.assertTrue(low <= q <= high)
        self.assertEqual(seen, set(REASONS))


class GuardUse(unittest.TestCase):
    def test_a_leap_becomes_a_legal_command_and_a_stop_ends_at_rest(self):
        guard = Guard(Limits([(-3.1, 3.1), (-1.0, 0.5)], [3.0, 1.5], [40.0, 20.0], hold_s=0.01, braking=[20.0, 10.0]))
        guard.begin([0.0, 0.0], 0)
        leap = guard.clamp([0.1, math.nan], 2_000_000)
        self.assertEqual((leap.q, leap.reasons, leap.altered), ([0.0, 0.0], ["not finite"], [0, 1]))
        for tick in range(2, 1000):
            verdict = guard.clamp([9.0, -9.0], tick * 2_000_000)
            self.assertTrue(verdict.q[0] <= 3.1 and verdict.q[1] >= -1.0)
        self.assertTrue(guard.viable)
        while not guard.at_rest:
            tick += 1
            verdict = guard.stop(tick * 2_000_000)
        self.assertEqual(verdict.qd, [0.0, 0.0])
        self.assertLess(tick, 1500)

    def test_limits_of_settings_are_those_of_the_follower(self):
        guard, follower = Guard("ur5"), Follower("ur5")
        self.assertEqual(guard.limits.position, follower.limits.position)
        self.assertEqual(guard.limits.braking, follower.limits.braking)
        guard.begin(follower.home, 5)
        self.assertEqual(guard.clamp(follower.home, 2_000_005).altered, [])

    def test_silence_never_goes_back_in_time(self):
        guard = Guard(Limits([(-1, 1)], [1.0], [10.0], hold_s=0.01))
        guard.begin([0.1], 50_000_000, [0.5])
        with self.assertRaisesRegex(Invalid, "now_ns is 49999999, before the last command at 50000000 ns"):
            guard.after_silence(49_999_999)
        self.assertEqual(guard.after_silence(50_000_000).q, [0.1])
        self.assertGreater(guard.after_silence(55_000_000).q[0], 0.1)

    def test_wrong_arguments_say_what_is_legal(self):
        guard = Guard("ur5")
        with self.assertRaisesRegex(Invalid, "call begin"):
            guard.clamp([0.0] * 6, 5)
        for work, why in [
            (lambda: guard.begin([0.0] * 5, 0), "q has 5 entries; the arm has 6"),
            (lambda: guard.begin([math.nan] * 6, 0), r"q\[0\] is NaN"),
            (lambda: guard.begin("abc", 0), "legal: a list of numbers"),
            (lambda: guard.begin([0.0] * 6, 0.5), "whole nanoseconds"),
            (lambda: Limits([(1, -1)], [1], [1]), r"\[1, -1\] rad are not an interval"),
            (lambda: Limits([(-1, 1)], [-1], [1]), "velocity limit -1"),
            (lambda: Limits([(-1, 1)], [1, 1], [1]), "velocity has 2 entries; the arm has 1"),
            (lambda: Limits([(-1, 1)], [1], [1], hold_s=2.0), "hold time 2"),
            (lambda: Limits([(-1, 1)] * 9, [1] * 9, [1] * 9), "9 joints; legal: 1 to 8"),
            (lambda: Limits(5, [1], [1]), "pairs"),
        ]:
            with self.assertRaisesRegex(Invalid, why):
                work()


def urdf(joints):
    """An arm of this many joints, each 0.3 m and turned against the one before."""
    text = ['<robot name="own"><link name="l0"/>']
    for n in range(joints):
        axis = ["0 0 1", "0 1 0", "1 0 0"][n % 3]
        text.append(
            f'<link name="l{n + 1}"/><joint name="j{n}" type="revolute"><parent link="l{n}"/><child link="l{n + 1}"/>'
            f'<origin xyz="0.1 {0.02 * n} 0.3" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>'
            '<limit lower="-2.5" upper="2.5" velocity="2" effort="50"/></joint>'
        )
    return "".join(text) + "</robot>"


class ChainBits(Scratch):
    def compare(self, chain, name, count, seed, words=()):
        rng = random.Random(seed)
        orders, answers = [], []
        for _ in range(count):
            values = [[rng.uniform(-2.4, 2.4) for _ in range(chain.joints)] for _ in range(3)]
            near = [q + rng.gauss(0, 0.3) for q in values[0]]
            orders.append([name, *words, *bits(values[0] + values[1] + values[2] + near)])
            pose = chain.forward(values[0])
            _, velocity, acceleration = chain.tool_motion(*values)
            own = bits(pose.position) + bits(pose.position) + bits(pose.rotation_vector)
            own += bits(n for row in pose.rotation for n in row) + bits(n for row in pose.jacobian for n in row)
            own += bits(velocity) + bits(acceleration)
            axis, spin = [row[2] for row in pose.rotation], [row[0] for row in pose.rotation]
            for found in (
                chain.inverse(pose.position, near, rotation=pose.rotation), chain.inverse(pose.position, near, axis=axis),
            ):
                own += ["-"] if found is None else bits(found)
            self.assertEqual(chain.inverse(pose.position, near, axis=axis, spin=spin), chain.inverse(pose.position, near, rotation=pose.rotation))
            answers.append(own)
        told = judged(orders)
        self.assertEqual(len(told), count)
        for own, answer in zip(answers, told):
            self.assertEqual(own, answer)

    def test_the_ur5_and_an_arm_of_seven_joints_are_those_of_the_rust_calls(self):
        self.compare(Chain.of("ur5"), "ur5", 40, 3)
        path = self.write("seven.urdf", urdf(7))
        self.compare(Chain(path), "urdf7", 20, 4, [path])

    def test_the_inverse_reaches_the_pose_and_out_of_reach_is_none(self):
        chain = Chain.of("ur5")
        home = Follower("ur5").home
        pose = chain.forward(home)
        target = [a + b for a, b in zip(pose.position, (0.02, -0.03, 0.01))]
        q = chain.inverse(target, home, rotation=pose.rotation)
        self.assertLess(max(abs(a - b) for a, b in zip(chain.forward(q).position, target)), 2e-9)
        self.assertIsNone(chain.inverse([9.0, 0.0, 0.0], home, rotation=pose.rotation))
        step, jacobian = 1e-6, chain.jacobian(home)
        for joint in range(6):
            moved = chain.forward([value + step * (at == joint) for at, value in enumerate(home)])
            for axis in range(3):
                self.assertAlmostEqual((moved.position[axis] - pose.position[axis]) / step, jacobian[axis][joint], 5)

    def test_texts_files_tools_and_links(self):
        chain = Chain(urdf(3))
        self.assertEqual((chain.joints, chain.base, chain.tip), (3, "l0", "l3"))
        self.assertEqual(chain.limits.names, ["j0", "j1", "j2"])
        self.assertEqual(chain.limits.position[0], (-2.5, 2.5))
        self.assertEqual(Chain(urdf(4), base="l1", tip="l3").joints, 2)
        plain, tool = chain.forward([0.1] * 3), Chain(urdf(3), tool_m=[0.0, 0.0, 0.2]).forward([0.1] * 3)
        along = [b + 0.2 * row[2] for b, row in zip(plain.position, plain.rotation)]
        self.assertLess(max(abs(a - b) for a, b in zip(along, tool.position)), 1e-12)
        if numpy is not None:
            self.assertEqual(chain.forward(numpy.array([0.1] * 3)).position, plain.position)

    def test_what_is_no_arm_is_named(self):
        chain, pose = Chain(urdf(3)), Chain(urdf(3)).forward([0.0] * 3)
        for work, error, why in [
            (lambda: Chain(urdf(9)), Invalid, "9 joints; legal: 1 to 8"),
            (lambda: Chain("<robot/>"), Problem, "link"),
            (lambda: Chain(self.path("none.urdf")), Problem, "none.urdf"),
            (lambda: Chain(urdf(2), tip="hand"), Problem, "hand"),
            (lambda: Chain(urdf(2).replace("revolute", "prismatic")), Problem, "prismatic"),
            (lambda: chain.forward([0.0, math.inf, 0.0]), Invalid, r"q\[1\] is inf"),
            (lambda: chain.inverse([0, 0, 0], [0.0] * 3, axis=[0, 0, 2]), Invalid, "axis has the length 2"),
            (lambda: chain.inverse([0, 0], [0.0] * 3, axis=[0, 0, 1]), Invalid, "position has 2 numbers"),
            (lambda: chain.inverse([0, 0, 0], [0.0] * 3), Invalid, "either rotation or axis"),
            (lambda: chain.inverse([0, 0, 0], [0.0] * 3, rotation=pose.rotation, spin=[1, 0, 0]), Invalid, "without spin"),
        ]:
            with self.assertRaisesRegex(error, why):
                work()


if __name__ == "__main__":
    unittest.main()
