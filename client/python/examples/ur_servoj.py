"""A Universal Robots arm by ur_rtde's servoJ: python ur_servoj.py [ADDRESS]. `foretrace arm ur` does it without Python."""

import sys

import foretrace
from foretrace.messages import EffortUnit
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1"
robot, sensors = RTDEControlInterface(address), RTDEReceiveInterface(address)
with foretrace.attach() as ft, ft.arm_interface(rate_hz=125) as arm:
    moving, newest_s = False, 0.0
    for target in arm:
        if target.move:
            robot.servoJ(target.q, 0.0, 0.0, 1.0 / arm.rate_hz, 0.03, 300)
        elif moving:
            robot.servoStop()
        moving = target.move
        # After a lost connection ur_rtde goes on giving its last packet, which is no new measurement.
        measured_s = sensors.getTimestamp()
        if measured_s != newest_s:
            newest_s = measured_s
            arm.measured(
                sensors.getActualQ(), sensors.getActualQd(), sensors.getActualCurrent(), effort_unit=EffortUnit.AMPERES,
                safety_mode=sensors.getSafetyMode(), robot_mode=sensors.getRobotMode() + 1, robot_stamp=round(measured_s * 1e9),
            )
