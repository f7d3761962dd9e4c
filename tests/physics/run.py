"""One run of `foretrace lab closed-loop` in front of an arm, and what it was like."""

import csv
import json
import os
import subprocess
import tempfile
import tomllib
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy as np

import lockstep
from arm import Arm, Plane

ROOT = Path(__file__).resolve().parents[2]
AFTER_TOUCH_S = 0.15  # a pen that comes down may be so late
REST_S = 1.0  # every run that stops goes on for so long
ANSWERS_S = 0.28  # the tracking monitor's memory: the longest lag, the spread of a filter, jitter


class Robot:
    """A preset's arm: URDF, limits, plane."""

    def __init__(self, preset):
        self.urdf = (ROOT / f"config/robots/{preset}.urdf").read_text()
        limits = [joint.find("limit").attrib for joint in xml.fromstring(self.urdf).iter("joint") if joint.get("type") != "fixed"]
        self.efforts = np.array([float(limit["effort"]) for limit in limits])
        self.speeds = np.array([float(limit["velocity"]) for limit in limits])
        base = tomllib.loads((ROOT / "config/presets/ur5.toml").read_text())["plane"]
        base |= tomllib.loads((ROOT / f"config/presets/{preset}.toml").read_text()).get("plane", {})
        self.workspace_m = base["workspace_m"]
        x, normal = np.array(base["x_axis"]), np.array(base["normal"])
        self.plane = Plane(np.array(base["origin_m"]), np.array([x, np.cross(normal, x), normal]))


def law(program, preset, pen, settings, folder, extra):
    """Starts the law; its JSON and its ticks come into `folder`."""
    arguments = [program, "lab", "closed-loop", "--preset", preset, "--predictors", "mixture", *pen, *extra]
    for setting in settings:
        arguments += ["--set", setting]
    arguments += ["--ticks", f"{folder}/ticks.csv", "--json", f"{folder}/run.json", "--out", f"{folder}/out"]
    return subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def read(folder):
    """The run's JSON, and its ticks as columns."""
    with open(f"{folder}/ticks.csv") as file:
        rows = list(csv.DictReader(file))
    columns = {}
    for name in rows[0] if rows else []:
        column = [row[name] for row in rows]
        columns[name] = np.array(column if name in ("mode", "stop") else [float(value) for value in column])
    return json.loads(Path(f"{folder}/run.json").read_text()), columns


def own(program, preset, pen, settings=()):
    """The same pen in front of foretrace's own arm."""
    with tempfile.TemporaryDirectory() as folder:
        process = law(program, preset, pen, settings, folder, ["--arms", "ur5"])
        _, errors = process.communicate()
        if process.returncode:
            raise RuntimeError(errors)
        return read(folder)


def physics(program, case, pen, stop_at_s=None):
    """The pen in front of the arm of `case`; a dictionary of figures, and the ticks."""
    robot = Robot(case.preset)
    settings = list(case.settings)
    if case.press_m:
        x, y, (_, high) = robot.workspace_m
        settings += [f"plane.press_m={case.press_m}", f"plane.workspace_m={[x, y, [-case.press_m - 5e-4, high]]}"]

    def make(home, period_s):
        return Arm(case, robot.urdf, robot.efforts, robot.speeds, robot.plane, home, period_s)

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "arm")
        listener = lockstep.listen(path)
        listener.settimeout(60)
        extra = ["--arm-socket", path, "--after-stop", str(REST_S)]
        if stop_at_s is not None:
            extra += ["--stop-at", str(stop_at_s)]
        process = law(program, case.preset, pen, settings, folder, extra)
        logs = []
        try:
            while process.poll() is None:
                listener.settimeout(1)
                try:
                    connection, _ = listener.accept()
                except TimeoutError:
                    continue
                with connection:
                    logs.append(lockstep.serve(connection, make).log)
            errors = process.stderr.read()
        finally:
            process.kill()
            listener.close()
        if process.returncode:
            raise RuntimeError(f"{case.name}: {errors}")
        told, ticks = read(folder)
    return figures(case, told, ticks, [np.array(log) for log in logs]), ticks


def outside(height_mm, command_mm, t_s):
    """How far along the plane's normal the tip was, at most, from all heights commanded in the last `ANSWERS_S` [mm]; the first second left out."""
    count = min(len(height_mm), len(command_mm))
    back = round(ANSWERS_S / np.median(np.diff(t_s[:1000])))
    if count <= back:
        return float("nan")
    lately = np.lib.stride_tricks.sliding_window_view(command_mm[:count], back + 1)
    away = np.maximum(height_mm[back:count] - lately.max(axis=1), lately.min(axis=1) - height_mm[back:count])
    away = away[t_s[back:count] > t_s[0] + 1.0]
    return float(max(0.0, np.nanmax(away))) if np.isfinite(away).any() else float("nan")


def figures(case, told, ticks, logs):
    """What a run was like, in millimetres, newtons and seconds; NaN where there is nothing to tell."""
    log = np.concatenate(logs)
    height_mm, paper, wall = log[:, 3] * 1e3, log[:, 4], log[:, 5]
    force = np.maximum(paper, wall)
    stops = [trial["stop"] for trial in told["trials"] if trial["stop"]]
    stop = stops[0] if stops else None
    row = told["rows"][0] if told["rows"] else None
    out = {
        "case": case.name,
        "rms_mm": 1e3 * np.sqrt(row["mse_m2"]) if row else float("nan"),
        "seconds": float(sum(trial["seconds"] for trial in told["trials"])),
        "stop": f"{stop['reason']} {stop['cause']}" if stop else "",
        "stop_s": stop["t_s"] if stop else float("nan"),
        "rest_ms": 1e3 * stop["rest_after_s"] if stop and stop["rest_after_s"] is not None else float("nan"),
        "illegal": sum(trial["illegal"] for trial in told["trials"]),
        "force_max_n": float(force.max()),
        "tip_lowest_mm": float(height_mm.min()),
        "saturated_pct": 100 * float(log[:, 6].mean()),
    }
    out["normal_mm"] = outside(height_mm, ticks["command_z_m"] * 1e3, ticks["t_s"])
    down = ticks["contact"] == 1
    period_s = np.median(np.diff(ticks["t_s"][:1000]))
    late = round(AFTER_TOUCH_S / period_s)
    written = down & (np.convolve(down, np.ones(late))[: len(down)] >= late)
    touching = written & (paper[: len(written)] > 0)
    out["contact_pct"] = 100 * touching.sum() / written.sum() if written.any() else float("nan")
    out["force_p50_n"] = float(np.median(paper[: len(written)][touching])) if touching.any() else 0.0
    out["force_p99_n"] = float(np.percentile(paper[: len(written)][written], 99)) if written.any() else 0.0
    if stop:
        at = int(np.argmax(log[:, 0] >= stop["t_s"] - 1e-9))
        out["force_at_stop_n"] = float(force[max(0, at - 5) : at + 1].max())
        out["force_left_n"] = float(force[-1])
        touched = np.flatnonzero(force[: at + 1] > 5.0)
        out["touch_to_stop_s"] = float(log[at, 0] - log[touched[0], 0]) if touched.size else float("nan")
        out["touched_before_stop_s"] = float(period_s * touched.size)
        # How far the command goes down after the stop, below the pressing depth and the place where the stop came.
        command_mm = ticks["command_z_m"] * 1e3
        after = command_mm[np.argmax(ticks["t_s"] >= stop["t_s"] - 1e-9) :]
        out["command_z_at_stop_mm"] = float(after[0])
        out["command_below_mm"] = float(max(0.0, min(-1e3 * case.press_m, after[0]) - np.nanmin(after)))
    else:
        out |= dict.fromkeys(("force_at_stop_n", "force_left_n", "touch_to_stop_s", "touched_before_stop_s"), float("nan"))
    return out
