"""Kills a recorder at random moments: its file mends, and what is lost is at most half a second of work. Arguments:
the program, the number of kills, a folder, and the options of a running daemon's instance."""

import json
import os
import random
import subprocess
import sys
import time

MOST_LOST_MS = 500


def main() -> int:
    program, kills, folder, at = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4:]

    def run(*words: str) -> str:
        return subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout

    random.seed(1)
    lost, problems = [], []
    for number in range(kills):
        path = os.path.join(folder, f"{number}.mcap")
        part, mended, table = path + ".part", os.path.join(folder, f"{number}.mended.mcap"), path + ".csv"
        recorder = subprocess.Popen([program, "record", path, *at], stderr=subprocess.DEVNULL)
        began = time.monotonic()
        while time.monotonic() - began < 60 and not (os.path.exists(part) and os.path.getsize(part) > 350_000):
            time.sleep(0.01)
        time.sleep(random.random() * 0.8)
        killed_ns = time.clock_gettime_ns(time.CLOCK_REALTIME)
        recorder.kill()
        recorder.wait()
        run("record", "--repair", part)
        damage = json.loads(run("record", "--info", mended, "--json", "-"))["damage"]
        if damage:
            problems.append(f"kill {number}: the mended file is damaged: {damage}")
        run("export", mended, "--csv", table, "--topic", "/raw/input", "--fields", "tick")
        with open(table, encoding="utf-8") as rows:
            last_ns = int(rows.read().splitlines()[-1].split(",")[0])
        lost.append((killed_ns - last_ns) * 1e-6)
        for name in (part, mended, table):
            os.remove(name)
    lost.sort()
    told = f"{kills} kills, lost {lost[len(lost) // 2]:.0f} ms in the median, {lost[-1]:.0f} ms at most"
    if lost[-1] > MOST_LOST_MS:
        problems.append(told)
    for problem in problems:
        print(f"broken: {problem}")
    if not problems:
        print(f"ok: {told}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
