"""An arm with physics behind the law, in lock-step and virtual time: python mujoco_lockstep.py URDF. Needs `pip install mujoco`
and the program `foretrace` on the PATH.

URDF is the description of the preset's robot (config/robots/ur5.urdf). Each joint has a stiff servo on top of the torques that
hold the arm up; the law's commands are its set-points.
"""

import sys

import mujoco
import numpy as np
from foretrace import lab

STIFFNESS, DAMPING = 1600.0, 80.0  # of a critically damped servo [1/s²], [1/s]
STEPS = 2  # of the simulation in a tick


class Simulated:
    """The arm of the description at `sys.argv[1]`."""

    def __init__(self, begin):
        self.model = mujoco.MjModel.from_xml_path(sys.argv[1])
        self.data = mujoco.MjData(self.model)
        self.model.opt.timestep = begin.period_s / STEPS
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # its shapes touch at its joints
        self.data.qpos[:] = begin.home
        self.q, self.goal, self.speed, self.torque = begin.home, np.array(begin.home), np.zeros(6), np.zeros(6)

    def step(self, command):
        if command.enabled:
            self.goal, self.speed = np.array(command.q), np.array(command.qd)
        else:
            self.speed = np.zeros(6)
        for _ in range(STEPS):
            mujoco.mj_forward(self.model, self.data)
            wanted = STIFFNESS * (self.goal - self.data.qpos) + DAMPING * (self.speed - self.data.qvel)
            mujoco.mj_mulM(self.model, self.data, self.torque, wanted)
            self.data.qfrc_applied[:] = self.torque + self.data.qfrc_bias
            mujoco.mj_step(self.model, self.data)
        return self.data.qpos, self.data.qvel


result = lab.closed_loop(Simulated, text="hello")
for row in result.rows:
    print(f"{row['predictor']}: rms {1e3 * row['mse_m2'] ** 0.5:.2f} mm")
print("stopped:", result.trials[0]["stop"])
