"""A simulated arm with physics, live: python mujoco_arm.py URDF. Needs `pip install mujoco`.

URDF is the robot's description that the daemon uses (config/robots/ur5.urdf). Each joint has a stiff servo on top of the
torques that hold the arm up; the daemon's commands are its set-points.
"""

import sys

import foretrace
import mujoco
import numpy as np
from foretrace.messages import RobotMode, SafetyMode

HOME = np.array([3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0])  # of the preset ur5 [rad]
STIFFNESS, DAMPING = 1600.0, 80.0  # of a critically damped servo [1/s²], [1/s]

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
model.opt.timestep = 0.001
model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # the description's shapes touch at its joints
data.qpos[:] = HOME
goal, speed = HOME.copy(), np.zeros(6)
torque = np.zeros(6)
with foretrace.attach() as ft, ft.arm_interface(rate_hz=250, simulated=True) as arm:
    for target in arm:
        goal, speed = (np.array(target.q), np.array(target.qd)) if target.move else (goal, np.zeros(6))
        for _ in range(4):
            mujoco.mj_forward(model, data)
            wanted = STIFFNESS * (goal - data.qpos) + DAMPING * (speed - data.qvel)
            mujoco.mj_mulM(model, data, torque, wanted)
            data.qfrc_applied[:] = torque + data.qfrc_bias
            mujoco.mj_step(model, data)
        arm.measured(data.qpos, data.qvel, safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)
