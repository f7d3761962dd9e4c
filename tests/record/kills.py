"""Kills a recorder at random moments: its file mends, what is lost is at most half a second of work, and pymcap-cli, where it is
there, recovers no message more. Arguments: the program, the number of kills, a folder, and the options of a running daemon's
instance."""

import json
import os
import random
import subprocess
import sys
import time

from mcap.reader import make_reader

MOST_LOST_MS = 500
# Beside this interpreter.
PYMCAP = os.path.join(os.path.dirname(sys.executable), "pymcap-cli")


def recovered(part: str, out: str) -> dict[str, int]:
    """Messages by topic in what pymcap-cli recovers."""
    done = subprocess.run([PYMCAP, "recover", part, out, "--force", "--compression", "none"], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"pymcap-cli: {done.stderr[-300:]}")
    with open(out, "rb") as file:
        summary = make_reader(file).get_summary()
    counts = summary.statistics.channel_message_counts.items()
    os.remove(out)
    return {summary.channels[channel].topic: count for channel, count in counts}


def main() -> int:
    program, kills, folder, at = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4:]

    def run(*words: str) -> str:
        return subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout

    random.seed(1)
    lost, problems, compared = [], [], 0
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
        info = json.loads(run("record", "--info", mended, "--json", "-"))
        if info["damage"]:
            problems.append(f"kill {number}: the mended file is damaged: {info['damage']}")
        if os.path.exists(PYMCAP):
            compared += 1
            for topic, count in recovered(part, path + ".recovered").items():
                if info["topics"].get(topic, 0) < count:
                    problems.append(f"kill {number}: {topic}: mended {info['topics'].get(topic, 0)}, recovered {count}")
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
        print(f"ok: {told}; {compared} compared with pymcap-cli recover")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
