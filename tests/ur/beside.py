"""universal-robots-clients and ur_rtde beside our bridge, which drives the same robot: nobody disturbs the other.

Usage: beside.py HOST RATE_HZ FORETRACE ROOT. Starts daemon, bridge and a hand that writes, with their shared memory below the folder
ROOT. One line a claim; exits with the number of claims that do not hold.
"""

import json
import pathlib
import signal
import subprocess
import sys
import time

import rtde_receive
from registers import Registers
from universal_robots_clients import rtde_client

HOST, RATE_HZ, FORETRACE, ROOT = sys.argv[1], float(sys.argv[2]), sys.argv[3], pathlib.Path(sys.argv[4])
PRESET = ["--preset", "ur5e" if RATE_HZ > 125 else "ur5"]
VALID = ["--set", "loop.valid_periods=12", "--set", "safety.joint_state_timeout_ms=500"]
PLACE = ["--instance", "9", "--root", str(ROOT / "r")]
REPORT = ROOT / "bridge.json"
# What a machine without time brings about, and no other client.
OF_THE_MACHINE = ("counters stayed away", "the controller ended the program, because no counters came")
broken = 0
processes = []


def claim(text, holds, seen=""):
    """Prints one line and counts what does not hold."""
    global broken
    broken += not holds
    print(f"{'ok    ' if holds else 'BROKEN'} beside the bridge {RATE_HZ:.0f} Hz: {text} {seen}", flush=True)


def wait(condition, seconds=60.0):
    """Waits until `condition()`; whether it came."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def start(*words):
    processes.append(subprocess.Popen([FORETRACE, *words, *PLACE], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    return processes[-1]


def ask(*words):
    return subprocess.run([FORETRACE, *words, *PLACE], capture_output=True, text=True, timeout=60)


def mode():
    asked = ask("status", "--json", "-")
    return json.loads(asked.stdout)["mode"] if asked.returncode == 0 else ""


def follows():
    ask("request", "arm")
    return wait(lambda: mode() == "following", 2.0)


def claims():
    start("daemon", "--no-rights", *PRESET, *VALID)
    claim("the daemon runs", wait(lambda: mode() != ""))
    bridge = start("arm", "ur", "--robot", HOST, "--json", str(REPORT), *PRESET, *VALID)
    start("play", "glyphs:ab", "--loop")
    claim("the arm follows the pen", wait(follows))

    client = rtde_client.connect(HOST)
    receive = rtde_receive.RTDEReceiveInterface(HOST)
    theirs = Registers(HOST).claim(range(24, 42))
    claim("registers 24 to 41 are the bridge's", theirs.count(b"IN_USE") >= 14, str(theirs[1:40]))
    others = Registers(HOST).claim([23])
    claim("the others are free", b"IN_USE" not in others, str(others))
    moved, began, number, looked = 0.0, time.monotonic(), 0, 0.0
    first = rtde_client.read_actual_joint_positions(client=client)
    while time.monotonic() < began + 10.0:
        number += 1
        rtde_client.write_input_int_register(42, number, client=client)
        rtde_client.write_input_double_register(43, 0.5 * number, client=client)
        rtde_client.write_tool_digital_output(number % 2, number % 3 == 0, client=client)
        joints = rtde_client.read_actual_joint_positions(client=client)
        moved = max(moved, max(abs(a - b) for a, b in zip(joints, first)))
        if time.monotonic() > looked + 1.0:
            # A machine that is too busy stops the arm by itself: then somebody arms again.
            looked = time.monotonic()
            mode() == "following" or ask("request", "arm")
        time.sleep(0.02)
    claim("both clients read, and one writes, for ten seconds", number > 50, f"{number} times")
    claim("while the bridge moves the arm", moved > 0.01, f"{moved:.3f} rad")
    claim("whose program goes on", receive.getRuntimeState() == 2)
    rtde_client.disconnect(client=client)
    receive.disconnect()
    claim("and the arm follows still", mode() == "following" or wait(follows))

    bridge.send_signal(signal.SIGINT)
    claim("the bridge ends well", bridge.wait(30) == 0)
    link = json.loads(REPORT.read_text())["arm"]["link"]
    others = {reason: count for reason, count in link["stops"].items() if not reason.startswith(OF_THE_MACHINE)}
    claim("and was never stopped by another client", not others, str(link["stops"]))
    figures = {key: link[key] for key in ("following_cycles", "late_cycles", "lost_counters", "jumps")}
    claim("it has led the arm", link["following_cycles"] > RATE_HZ and link["jumps"] == 0, str(figures))
    claim("its registers are free again", wait(lambda: b"IN_USE" not in Registers(HOST).claim(range(24, 42)), 10.0))


try:
    claims()
except Exception as error:
    claim("no exception", False, repr(error))
finally:
    for process in reversed(processes):
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
sys.exit(broken)
