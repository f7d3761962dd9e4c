"""What an arm's program in Python costs the loop when Python stands still: `foretrace.ArmInterface` beside a loop in a
Python thread over the messages themselves. Prints the table of docs/connect/python.md.

    python tests/python/lock_table.py [--rounds 5] [--out TABLE.md]

FORETRACE is the program (default: target/debug/foretrace). Each round has a daemon of its own (preset ur5, states lost after
100 ms), a pen that writes (`foretrace play`), and a perfect arm in a process of its own, in which the fault happens while the
arm follows the pen. States are what another process received; what the arm was told is what its program read.
"""

import argparse
import ctypes
import gc
import mmap
import os
import pathlib
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time

import foretrace
from foretrace.messages import JointState, Mode, RobotMode, SafetyMode

HOME = [3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0]
RATE_HZ = 250
PAUSE_S = 0.3
#: The fault happens while a joint is at least this fast [rad/s].
FAST_RADPS = 0.2
FAULTS = {
    "none": "Python idle",
    "computing": "another thread computes for 300 ms",
    "short": "the arm's own loop blocked for 150 ms",
    "blocked": "the arm's own loop blocked for 300 ms",
    "lock": "another thread holds the interpreter lock for 300 ms",
    "garbage": "garbage is collected",
    "killed": "killed",
}
#: When, what the arm was told (0 stand, 1 move), and its joints.
TOLD = struct.Struct("<dq6d")


# The arm's process.


class Told:
    """Survives a kill, and does not release the interpreter lock: a mapped file."""

    MOST = 100_000

    def __init__(self, path):
        with open(path, "w+b") as file:
            file.truncate(self.MOST * TOLD.size)
            self.map = mmap.mmap(file.fileno(), 0)
        self.count = 0
        self.block_s = 0.0
        self.fast = threading.Event()

    def __call__(self, move, q, qd):
        TOLD.pack_into(self.map, self.count * TOLD.size, time.monotonic(), move, *q)
        self.count += 1
        if max(map(abs, qd)) > FAST_RADPS:
            self.fast.set()
        if self.block_s:
            pause, self.block_s = self.block_s, 0.0
            time.sleep(pause)


def by_interface(ft, told):
    arm = ft.arm_interface(RATE_HZ, pause_after=0.1, simulated=True)
    q, qd = list(HOME), [0.0] * 6
    for target in arm:
        if target.move:
            q, qd = target.q, target.qd
        else:
            qd = [0.0] * 6
        told(target.move, q, qd)
        arm.measured(q, qd, safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)


def by_loop(ft, told):
    ports = ft.arm_ports()
    q, qd = list(HOME), [0.0] * 6
    for _ in foretrace.Pace(RATE_HZ):
        now = time.monotonic_ns()
        newest = ports.latest()
        state = JointState()
        demand = None
        if newest is not None:
            command, state = newest
            demand = foretrace.demand_at(command, now)
        if demand is not None:
            q, qd = demand
        else:
            qd = [0.0] * 6
        told(demand is not None, q, qd)
        state.q[:], state.qd[:] = q, qd
        state.safety_mode, state.robot_mode = SafetyMode.NORMAL, RobotMode.RUNNING
        ports.publish(state, time.monotonic_ns())


def arm_process(kind, fault, path):
    ft = foretrace.attach()
    told = Told(path)
    loop = by_interface if kind == "interface" else by_loop
    thread = threading.Thread(target=loop, args=(ft, told), daemon=True)
    thread.start()
    ballast = None
    if fault == "garbage":
        gc.disable()
        ballast = [[number, [number]] for number in range(2_000_000)]
    sys.stdin.readline()
    told.fast.clear()
    told.fast.wait(10.0)
    begin = time.monotonic()
    print(begin, flush=True)
    if fault == "computing":
        while time.monotonic() - begin < PAUSE_S:
            sum(range(1000))
    elif fault in ("short", "blocked"):
        told.block_s = PAUSE_S if fault == "blocked" else 0.5 * PAUSE_S
    elif fault == "lock":
        # A call through PyDLL keeps the lock, as an extension module does that never releases it.
        ctypes.PyDLL(None).usleep(round(PAUSE_S * 1e6))
    elif fault == "garbage":
        gc.collect()
    elif fault == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    print(time.monotonic(), flush=True)
    sys.stdin.readline()
    del ballast
    os._exit(0)


# The observer.


def round_of(program, kind, fault):
    """One round: longest gap in states, fault's own length, largest step told, when daemon and consumer braked."""
    with tempfile.TemporaryDirectory(prefix="fp-", dir="/tmp") as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        children = []

        def start(*arguments, **options):
            child = subprocess.Popen(arguments, **options)
            children.append(child)
            return child

        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        start(program, "daemon", "--no-rights", "--preset", "ur5", "--set", "safety.joint_state_timeout_ms=100", **quiet)
        try:
            with foretrace.attach(wait=20.0) as ft:
                path = f"{folder}/told"
                arm = start(
                    sys.executable, __file__, "--arm", kind, fault, path,
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                )
                start(program, "play", "glyphs:abcdefghij", "--loop", **quiet)
                deadline = time.monotonic() + 40.0
                while True:
                    try:
                        ft.arm()
                        ft.wait_until(lambda status: status.mode == Mode.FOLLOWING, timeout=10.0)
                        break
                    except (foretrace.Refused, foretrace.NoAnswer):
                        if time.monotonic() > deadline:
                            raise
                        time.sleep(0.1)
                # The writer's arm has come to its pen and is on its way.
                time.sleep(2.0)
                states, ticks = ft.records("joints"), ft.records("ticks")
                time.sleep(0.1)
                arm.stdin.write("\n")
                arm.stdin.flush()
                begin = float(arm.stdout.readline())
                time.sleep(1.5)
                end = arm.stdout.readline()
                stamps = [state.header.stamp_ns * 1e-9 for state in states.drain_records()]
                modes = [(tick.header.stamp_ns * 1e-9, tick.mode) for tick in ticks.drain_records()]
        finally:
            for child in reversed(children):
                child.kill()
                child.wait()
        data = pathlib.Path(path).read_bytes()
    told = [TOLD.unpack_from(data, at) for at in range(0, len(data) - TOLD.size + 1, TOLD.size)]
    # The rest of the file is zero.
    told = [(when, move, q) for when, move, *q in told if begin - 0.05 < when < begin + 1.5]
    gap = max((b - a for a, b in zip(stamps, stamps[1:]) if b > begin), default=0.0)
    step = max(
        (max(abs(x - y) for x, y in zip(one[2], two[2])) for one, two in zip(told, told[1:]) if two[1] and two[0] > begin),
        default=0.0,
    )
    return {
        "length": float(end) - begin if end else None,
        "gap": None if stamps[-1] < begin + 0.7 and fault == "killed" else gap,
        "step": step,
        "daemon": next((when - begin for when, mode in modes if when > begin and mode == Mode.STOPPED), None),
        "consumer": next((when - begin for when, move, _ in told if when > begin and not move), None),
        "told": len(told),
    }


def cell(rounds, name, scale, digits=0, nothing="–"):
    values = sorted(one[name] for one in rounds if one[name] is not None)
    if not values:
        return nothing
    text = f"{statistics.median(values) * scale:.{digits}f} / {values[-1] * scale:.{digits}f}"
    return text if len(values) == len(rounds) else f"{text} ({len(values)} of {len(rounds)})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out")
    parser.add_argument("--faults", default=",".join(FAULTS))
    parser.add_argument("--arm", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.arm:
        arm_process(*arguments.arm)
        return
    root = pathlib.Path(__file__).resolve().parents[2]
    program = os.environ.get("FORETRACE", str(root / "target/debug/foretrace"))
    lines = [
        "| what happens to Python | arm's program | longest gap in states [ms] | largest step told [mrad] | daemon stopped after [ms] "
        "| arm told to stand after [ms] |",
        "|---|---|---|---|---|---|",
    ]
    for fault in arguments.faults.split(","):
        for kind in ("interface", "loop"):
            rounds = [round_of(program, kind, fault) for _ in range(arguments.rounds)]
            words = FAULTS[fault]
            if fault == "garbage":
                words += f" ({cell(rounds, 'length', 1e3)} ms)"
            name = "`arm_interface`" if kind == "interface" else "loop in a thread"
            nobody = "never: nobody is there" if fault == "killed" else "–"
            lines.append(
                f"| {words} | {name} | {cell(rounds, 'gap', 1e3, 1, 'no more states')} | {cell(rounds, 'step', 1e3, 1)} "
                f"| {cell(rounds, 'daemon', 1e3)} | {cell(rounds, 'consumer', 1e3, 0, nobody)} |"
            )
            print(lines[-1], flush=True)
    if arguments.out:
        pathlib.Path(arguments.out).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
