"""The law before physics of others: MuJoCo and Pinocchio judge foretrace in lock-step.

Prints a table and one line a claim; exits with the number of claims that do not hold (at most 100). FORETRACE_DATA: a folder with recorded hands (unipen-tos, pendigits-orig, ...) beside the built-in writer.
"""

import argparse
import json
import math
import os
import sys
from dataclasses import replace

import numpy as np

from arm import Case, Push, Wall
from chain import check
from run import own, physics

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("program")
parser.add_argument("results", nargs="?", help="file for all figures, JSON")
parser.add_argument("--only", default="", help="only cases with this word in their name")
parser.add_argument("--quick", action="store_true", help="one pen, the built-in writer's first")
options = parser.parse_args()
PROGRAM, RESULTS, ONLY, QUICK = options.program, options.results, options.only, options.quick
PAPER_NPM, WALL_NPM = 20e3, 200e3
results, broken = [], 0

TEXTS = ["foretrace", "hello", "R8g3", "zigzag", "mixture"]
PENS = {text: ["--text", text] for text in TEXTS}
DATA = os.environ.get("FORETRACE_DATA")
for name in ("unipen-tos", "pendigits-orig", "character-trajectories") if DATA else ():
    if os.path.isdir(f"{DATA}/{name}"):
        PENS[name] = ["--data", f"{DATA}/{name}", "--hands", "1", "--limit", "6"]


def claim(what, text, holds, seen=""):
    """Prints one line and counts what does not hold."""
    global broken
    broken += not holds
    print(f"{'ok    ' if holds else 'BROKEN'} {what}: {text} {seen}", flush=True)


HEADINGS = ("rms_mm", "force_max_n", "force_at_stop_n", "force_left_n", "contact_pct", "force_p50_n", "tip_lowest_mm", "normal_mm", "rest_ms", "saturated_pct")


def show(pen, figures):
    numbers = " ".join(f"{figures[name]:>9.2f}" if figures[name] == figures[name] else f"{'-':>9}" for name in HEADINGS)
    stop = f"{figures['stop']} after {figures['stop_s']:.3f} s" if figures["stop"] else "-"
    print(f"{figures['case']:<28} {pen:<22} {numbers}  {stop}", flush=True)


def run(case, pen, stop_at_s=None):
    figures, ticks = physics(PROGRAM, case, PENS[pen], stop_at_s)
    results.append({"pen": pen} | figures)
    show(pen, figures)
    return figures, ticks


def wanted(word):
    return not ONLY or ONLY in word


paper = Wall((0, 0, 1), 0.0, PAPER_NPM)
nominal = Case("nominal", walls=[paper])
shapes = {}  # ticks of the nominal arm, by pen
pens = list(PENS)[:1] if QUICK else list(PENS)
few = [pens[0], *pens[5:6]]
print(f"{'case':<28} {'pen':<22} " + " ".join(f"{name[:9]:>9}" for name in HEADINGS) + "  stop")

for preset, cycle_s in (("ur5e", 0.002), ("ur5", 0.008)):
    for pen in pens if preset == "ur5e" else few:
        if not wanted("nominal") and not wanted("stops"):
            continue
        case = replace(nominal, name=f"nominal {preset}", preset=preset, cycle_s=cycle_s)
        figures, ticks = run(case, pen)
        if preset == "ur5e":
            shapes[pen] = ticks
        who = f"nominal {preset}, {pen}"
        claim(who, "no stop, no illegal command", not figures["stop"] and figures["illegal"] == 0, figures["stop"])
        for text, holds, seen in check(preset, ticks):
            claim(who, text, holds, seen)
        if preset != "ur5e":
            continue  # foretrace's own arm cycles at the loop's rate: at 125 Hz it would be another one
        told, _ = own(PROGRAM, preset, PENS[pen])
        own_mm = 1e3 * math.sqrt(told["rows"][0]["mse_m2"])
        off = figures["rms_mm"] / own_mm - 1
        claim(who, "error at most 5 % more and 10 % less than with foretrace's own arm, or 0.05 mm", -0.1 <= off <= 0.05 or abs(figures["rms_mm"] - own_mm) <= 0.05, f"({100 * off:+.1f} %, {own_mm:.2f} mm)")

benign = [
    replace(nominal, name="zeta 0.7", zeta=0.7),
    replace(nominal, name="zeta 0.52", zeta=0.52),
    replace(nominal, name="zeta 0.5", zeta=0.5),
    replace(nominal, name="5 kg unknown", payload_kg=5.0),
    replace(nominal, name="friction x3", friction=3.0),
    replace(nominal, name="torque x0.4", torque=0.4),
    replace(nominal, name="push 30 N", pushes=[Push(2.5, 0.2, (30, 0, 0)), Push(4.0, 0.2, (0, -30, 0))]),
    replace(nominal, name="push 60 N", pushes=[Push(2.5, 0.3, (60, 0, 0))]),
]
for case in benign:
    for pen in few if wanted(case.name) else ():
        figures, _ = run(case, pen)
        claim(f"{case.name}, {pen}", "no stop", not figures["stop"], figures["stop"])

# A pen of 2 N/mm on the paper, told to press by 0.5 and 1 mm; a rigid one, told to press, pushes with all it has.
spring = Wall((0, 0, 1), 0.0, 1 / (1 / PAPER_NPM + 1 / 2e3))
if wanted("spring"):
    for pen in pens if pens == list(PENS)[:1] else [*pens[:5], *pens[5:6]]:
        rigid, _ = run(replace(nominal, name="spring: rigid, press 0"), pen)
        for press_m, least_n, most_n in ((0.0005, 0.5, 1.5), (0.001, 1.4, 2.4)):
            figures, _ = run(replace(nominal, name=f"spring, press {1e3 * press_m:.1f} mm", walls=[spring], press_m=press_m), pen)
            who = f"spring pressed by {1e3 * press_m:.1f} mm, {pen}"
            claim(who, "touches 99 % of the pen-down time, a rigid pen at z = 0 less than 75 %", figures["contact_pct"] >= 99 and rigid["contact_pct"] < 75, f"({figures['contact_pct']:.1f} %, {rigid['contact_pct']:.1f} %)")
            claim(who, f"presses {least_n} to {most_n} N", least_n <= figures["force_p50_n"] <= most_n, f"({figures['force_p50_n']:.2f} N; 99 %: {figures['force_p99_n']:.2f}, largest {figures['force_max_n']:.2f} N)")
    figures, _ = run(replace(nominal, name="spring: rigid, press 1.0 mm", press_m=0.001), pens[0])
    claim("a rigid pen pressed by 1 mm", "is what a spring is for: more than 10 N", figures["force_p50_n"] > 10, f"({figures['force_p50_n']:.1f} N; 99 %: {figures['force_p99_n']:.1f}, largest {figures['force_max_n']:.1f} N)")


def flange_wall(ticks):
    """A wall that lets the flange, where its surface stands as far out as the pen's tip, go to 15 mm before the writing's right edge."""
    right_m = np.nanmax(ticks["command_x_m"][ticks["contact"] == 1])
    return Wall((-1, 0, 0), -(right_m - 0.015), WALL_NPM, (0.0, 0.0, 0.0), "wall")


# The largest force [N] that physics of others found before contacts were watched, for as long as it wrote; the share of that which
# may be met now, and the time of touching until the stop [s]. Paper 8 mm too high is met with the force of its first stroke.
bad = [
    ("paper +3 mm", lambda _: [Wall((0, 0, 1), 0.003, PAPER_NPM)], 58.0, 1.1, 1.0),
    ("paper +8 mm", lambda _: [Wall((0, 0, 1), 0.008, PAPER_NPM)], 149.0, 1.1, 3.5),
    ("wall 15 mm inside", lambda ticks: [paper, flange_wall(ticks)], 814.0, 0.5, 1.0),
    ("flange on a table", lambda _: [Wall((0, 0, 1), 0.154, WALL_NPM, (0.0, 0.0, 0.0), "wall")], 372.0, 0.9, 1.0),
]
# The built-in writer touches paper 3 mm too high for 0.3 s at a time, which is too short and too light to be told from friction.
borne = {("paper +3 mm", list(PENS)[0])}


for name, walls, today_n, share, within_s in bad:
    for pen in few if wanted(name) else ():
        if pen not in shapes:
            shapes[pen] = physics(PROGRAM, nominal, PENS[pen])[1]
        figures, _ = run(replace(nominal, name=name, walls=walls(shapes[pen])), pen)
        seen = f"({figures['stop'] or 'no stop'}, touched for {figures['touched_before_stop_s']:.2f} s, at most {figures['force_max_n']:.0f} N; without a watch {today_n:.0f} N)"
        if (name, pen) not in borne:
            claim(f"{name}, {pen}", f"is noticed within {within_s} s of touching", figures["stop"] != "" and figures["touched_before_stop_s"] <= within_s, seen)
        claim(f"{name}, {pen}", f"with at most {share} of the force without a watch", figures["force_max_n"] <= share * today_n, seen)

# A wrist at a tenth of its speed takes the tool nowhere: that it is slow does no harm, and is not looked for.
for joint in (0, 1):
    if wanted("slow"):
        figures, _ = run(replace(nominal, name=f"joint {joint} at 10 %", slow={joint: 0.1}), pens[0])
        claim(f"joint {joint} at a tenth of its speed", "is noticed", bool(figures["stop"]), figures["stop"])


def strokes(ticks, count):
    """Instants with the pen down and moving, spread over the run."""
    speed = np.hypot(np.gradient(ticks["pen_x_m"]), np.gradient(ticks["pen_y_m"])) / np.gradient(ticks["t_s"])
    moving = np.flatnonzero((ticks["contact"] == 1) & (np.convolve(speed, np.ones(9) / 9, "same") > 0.03))
    return ticks["t_s"][moving[(np.linspace(0.05, 0.95, count) * (len(moving) - 1)).astype(int)]] if moving.size else []


def landings(ticks, count):
    """Instants at which the command comes down onto the paper, 0.3 to 3 mm above it."""
    z_m = ticks["command_z_m"]
    down = np.flatnonzero((np.gradient(z_m) < -0.03 * np.gradient(ticks["t_s"])) & (z_m > 3e-4) & (z_m < 3e-3))
    first = down[np.diff(down, prepend=-100) > 50]
    return ticks["t_s"][first[(np.linspace(0, 1, count) * (len(first) - 1)).astype(int)]] if first.size else []


def stopped(case, pen, at_s):
    """A stop there; the command stays above, wherever the pen was."""
    figures, _ = run(case, pen, float(at_s))
    text = "the command goes at most 0.1 mm below the pressing depth and the place of the stop"
    claim(f"{case.name} at {at_s:.3f} s, {pen}", text, figures["command_below_mm"] <= 0.1, f"({figures['command_below_mm']:.3f} mm, from {figures['command_z_at_stop_mm']:.2f} mm, stands with {figures['force_left_n']:.1f} N, at rest after {figures['rest_ms']:.0f} ms)")
    return figures


if wanted("stops"):
    stops = []
    for pen in list(shapes)[: 1 if QUICK else 5]:
        stops += [stopped(replace(nominal, name="stop in mid stroke"), pen, at_s) for at_s in strokes(shapes[pen], 5)]
        for at_s in landings(shapes[pen], 2):
            stopped(replace(nominal, name="stop while landing"), pen, at_s)
    pressed = replace(nominal, name="stop, spring pressed by 1 mm", walls=[spring], press_m=0.001)
    for at_s in strokes(shapes[pens[0]], 5):
        stopped(pressed, pens[0], at_s)
    # Where every joint braked by itself the longest of these was 66 ms (and the deepest 1.00 mm, with 19 N); the paper may cost 20 ms.
    claim("stops", "are at rest after 86 ms", all(stop["rest_ms"] <= 86 for stop in stops), f"(longest {max(stop['rest_ms'] for stop in stops):.0f} ms)")
    claim("stops", "leave less than 5 N on a rigid pen", all(stop["force_left_n"] < 5 for stop in stops), f"(largest {max(stop['force_left_n'] for stop in stops):.1f} N)")

if RESULTS:
    with open(RESULTS, "w") as file:
        json.dump({"results": results, "broken": broken}, file, indent=1)
print(f"physics: {broken} claims broken")
sys.exit(min(broken, 100))
