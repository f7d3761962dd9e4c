"""urx, urkit and universal-robots-clients against `foretrace ur-sim`.

Usage: others.py HOST RATE_HZ. One line a claim; exits with the number of claims that do not hold.
"""

import sys
import threading
import time

from registers import Registers

HOST, RATE_HZ = sys.argv[1], float(sys.argv[2])
broken = 0


def claim(who, text, holds, seen=""):
    """Prints one line and counts what does not hold."""
    global broken
    broken += not holds
    print(f"{'ok    ' if holds else 'BROKEN'} {who} {RATE_HZ:.0f} Hz: {text} {seen}", flush=True)


def try_all(who, body):
    """Runs one client's claims; an exception is one that does not hold."""
    global broken
    try:
        body()
    except Exception as error:
        claim(who, "no exception", False, repr(error))


def off(a, b):
    """Largest difference of two lists."""
    return max(abs(x - y) for x, y in zip(a, b))


def wait(condition, seconds=10.0):
    """Waits until `condition()`; whether it came."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def urx_claims():
    # urx is older than Python 3.10, math3d 4 and software 3.5: notifyAll and PoseVector.tolist went since,
    # and it reads modes and outputs in the layout of 3.4.
    threading.Condition.notifyAll = threading.Condition.notify_all
    import urx

    robot = urx.Robot(HOST, use_rt=True)
    try:
        joints = robot.getj()
        claim("urx", "six joints from port 30002", len(joints) == 6 and max(map(abs, joints)) < 6.3)
        pose = robot.secmon.get_cartesian_info(wait=True)
        claim("urx", "the tool's pose", 0.1 < (pose["X"] ** 2 + pose["Y"] ** 2) ** 0.5 < 1.0)
        real_time = robot.get_realtime_monitor()
        real_time.wait()
        claim("urx", "the same joints from port 30003", off(real_time.q_actual(), joints) < 1e-3)
        target = [joints[0] + 0.1] + list(joints[1:])
        robot.movej(target, acc=1.0, vel=0.5, wait=False)
        claim("urx", "movej is there", wait(lambda: off(robot.getj(wait=True), target) < 1e-3))
        robot.movej(joints, acc=1.0, vel=0.5, wait=False)
        claim("urx", "and back", wait(lambda: off(robot.getj(wait=True), joints) < 1e-3))
    finally:
        robot.close()


def clients_claims():
    who = "universal-robots-clients"
    from universal_robots_clients import rtde_client

    ours = Registers(HOST)
    reply = ours.claim(range(24, 42))
    claim(who, "registers 24 to 41 are another's", reply[0] == 1 and b"IN_USE" not in reply)
    client = rtde_client.connect(HOST)
    claim(who, "connects beside it", rtde_client.is_connected(client=client))
    rtde_client.write_input_int_register(42, 7, client=client)
    joints = rtde_client.read_actual_joint_positions(client=client)
    claim(who, "six joints", len(joints) == 6)
    claim(who, "the robot runs", rtde_client.read_robot_mode(client=client) == 7)
    claim(who, "what it has is in use", b"IN_USE" in Registers(HOST).claim([42]))
    rtde_client.write_speed_slider_fraction(0.8, client=client)
    seen = lambda: abs(rtde_client.read_speed_slider_fraction(client=client) - 0.8) < 1e-6
    claim(who, "the slider is set", wait(seen))
    rtde_client.write_speed_slider_fraction(1.0, client=client)
    rtde_client.disconnect(client=client)
    claim(who, "gone, it has left its registers", wait(lambda: b"IN_USE" not in Registers(HOST).claim([42])))


def urkit_claims():
    import urkit

    if RATE_HZ <= 125:
        # It insists on remote control, which a CB3 does not know.
        text = "leaves a CB3 alone, which knows no remote control"
        try:
            urkit.URRobot(HOST)
            claim("urkit", text, False)
        except urkit.exceptions.URKitConnectionError as error:
            claim("urkit", text, "remote control" in str(error))
        return
    robot = urkit.URRobot(HOST)
    joints = robot.get_joint_positions()
    claim("urkit", "connects, powers on, releases brakes", len(joints) == 6)
    robot.set_digital_output(1, True)
    claim("urkit", "a digital output is set", wait(lambda: robot.get_digital_output(1)))
    robot.stop()
    claim("urkit", "stop", not robot.is_moving() and not robot.is_protective_stopped())
    robot.disconnect()


try_all("urx", urx_claims)
try_all("universal-robots-clients", clients_claims)
try_all("urkit", urkit_claims)
sys.exit(broken)
