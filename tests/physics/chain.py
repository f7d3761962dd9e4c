"""Pinocchio on the commands as they were sent: kinematics, limits by stamps, torques."""

import numpy as np
import pinocchio

from arm import COULOMB_NM, PEN_M, ROTOR_KGM2, STRIBECK_RADPS, VISCOUS_NMS
from run import Robot

PEN_KG, PEN_CENTRE_M = 0.3, 0.07
ACCELERATION_RADPS2 = 40.0


def check(preset, ticks):
    """(claim, holds, what was seen) of a run's ticks."""
    robot = Robot(preset)
    model = pinocchio.buildModelFromXML(robot.urdf)
    tool = model.getFrameId("tool0")
    sent = {name: np.stack([ticks[f"{name}{joint}"] for joint in range(1, 7)], 1) for name in ("q", "qd", "measured_q")}
    commanded = np.flatnonzero(np.isfinite(sent["q"][:, 0]) & (ticks["enabled"] == 1))
    tips = {"q": "command", "measured_q": "tool"}
    data = model.createData()
    off = 0.0
    for name, places in tips.items():
        told = np.stack([ticks[f"{places}_{axis}_m"] for axis in "xyz"], 1)
        for tick in commanded[::10]:
            pinocchio.framesForwardKinematics(model, data, sent[name][tick])
            tip = data.oMf[tool].act(np.array([0.0, 0.0, PEN_M]))
            off = max(off, np.abs(robot.plane.to(tip) - told[tick]).max())
    yield "commanded and measured tool are Pinocchio's", off < 1e-9, f"(within {off:.1e} m)"

    frame = model.frames[tool]
    placement = frame.placement * pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, PEN_CENTRE_M]))
    pen = pinocchio.Inertia(PEN_KG, np.zeros(3), 1e-3 * PEN_KG * np.eye(3))
    model.appendBodyToJoint(frame.parentJoint, pen, placement)
    data = model.createData()
    pairs = commanded[1:][np.diff(commanded) == 1]
    spans = (ticks["t_s"][pairs] - ticks["t_s"][pairs - 1])[:, None]
    qdd = (sent["qd"][pairs] - sent["qd"][pairs - 1]) / spans
    most = np.abs(qdd).max()
    yield "no joint is asked for more than 40 rad/s2, by the stamps", most <= ACCELERATION_RADPS2 * (1 + 1e-6), f"({most:.3f})"
    fastest = (np.abs(sent["qd"][pairs]) / robot.speeds).max()
    yield "nor for more than its speed", fastest <= 1, f"({100 * fastest:.0f} %)"
    share = np.zeros(6)
    for tick, acceleration in zip(pairs, qdd):
        qd = sent["qd"][tick]
        friction = COULOMB_NM * np.tanh(qd / STRIBECK_RADPS) + VISCOUS_NMS * qd
        torque = pinocchio.rnea(model, data, sent["q"][tick], qd, acceleration) + ROTOR_KGM2 * acceleration + friction
        share = np.maximum(share, np.abs(torque) / robot.efforts)
    told = " ".join(f"{100 * part:.0f}" for part in share)
    yield "commands as sent need less than every joint's torque, friction and a pen of 0.3 kg included", share.max() < 1, f"({told} %)"
