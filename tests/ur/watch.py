"""Somebody else's eyes on the arm: the receive client of ur_rtde, as a process of its own.

Usage: watch.py HOST RATE_HZ. A line a state until it is killed: time on the controller's clock [s], six joints [rad], six
accelerations asked for [rad/s²].
"""

import sys
import time

import rtde_receive

HOST, RATE_HZ = sys.argv[1], float(sys.argv[2])

receive = rtde_receive.RTDEReceiveInterface(HOST, RATE_HZ, ["timestamp", "actual_q", "target_qdd"])
before = 0.0
while True:
    stamp = receive.getTimestamp()
    q, qdd = receive.getActualQ(), receive.getTargetQdd()
    # What was read belongs together only if no other state came meanwhile.
    if stamp != before and receive.getTimestamp() == stamp:
        print(stamp, *q, *qdd, flush=True)
        before = stamp
    time.sleep(0.4 / RATE_HZ)
