#!/usr/bin/env python3
"""The first minutes on a busy machine: tests/busy/judge.py [RUNS].

Four loops that compute for each CPU, then RUNS (default 20) times `foretrace demo`, and `foretrace console --sim`
without a pen. At least nine of ten end in order, or stay armed; the others name the want of CPU and its length.
Skipped without real-time rights, because without them the loop is no busier than its arm. FORETRACE is the program
(default: built here)."""

import json
import os
import re
import signal
import subprocess
import sys
import time

STARVED = re.compile(r"this machine was too busy for the simulated arm for \d+ ms")
ARMED_S = 10
PATIENCE_S = 60


def program():
    path = os.environ.get("FORETRACE")
    if path is None:
        subprocess.run(["cargo", "build", "--package", "foretrace", "--bin", "foretrace", "--locked"], check=True)
        path = "target/debug/foretrace"
    return os.path.realpath(path)


def has_rights():
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        return True
    except OSError:
        return False


def demo(foretrace):
    try:
        run = subprocess.run([foretrace, "demo", "--seconds", "6"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                             timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired as late:
        return False, f"{late}: {late.output}"
    return run.returncode == 0, run.stdout


def mode(foretrace, root):
    asked = subprocess.run([foretrace, "status", "--json=-", "--root", root], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                           timeout=PATIENCE_S, check=False)
    return json.loads(asked.stdout)["mode"] if asked.returncode == 0 else "no answer"


def console(foretrace):
    with open("console.txt", "w", encoding="utf-8") as words:
        process = subprocess.Popen([foretrace, "console", "--sim", "--port=0"], stdout=words, stderr=words)
    try:
        told, begin, armed = "", time.monotonic(), None
        while time.monotonic() - begin < PATIENCE_S and (armed is None or time.monotonic() - armed < ARMED_S):
            time.sleep(0.5)
            with open("console.txt", encoding="utf-8") as file:
                told = file.read()
            root = re.search(r"tablet --root (\S+)", told)
            if process.poll() is not None:
                return False, told
            if root is None:
                continue
            now = mode(foretrace, root[1])
            if now in ("armed", "following", "holding"):
                armed = armed or time.monotonic()
            elif armed is not None:
                return False, f"{told}\nmode: {now}"
        return armed is not None, told
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=PATIENCE_S)


def main():
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    if not has_rights():
        print("busy: skipped: no real-time rights (ulimit -r)")
        return 0
    foretrace, cpus = program(), len(os.sched_getaffinity(0))
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4 * cpus)]
    failed = False
    os.makedirs("target/busy", exist_ok=True)
    os.chdir("target/busy")
    try:
        for name, judged in (("demo", demo), ("console", console)):
            well, unnamed = 0, 0
            for number in range(runs):
                fine, told = judged(foretrace)
                well += fine
                if not fine:
                    reason = STARVED.search(told)
                    unnamed += reason is None
                    print(f"{name} {number + 1}: {reason[0] if reason else 'WITHOUT A REASON: ' + told}", flush=True)
            print(f"{name}: {well} of {runs} in order under {len(busy)} busy loops on {cpus} CPUs", flush=True)
            failed |= well < 0.9 * runs or unnamed > 0
    finally:
        for process in busy:
            process.kill()
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
