#!/usr/bin/env bash
# Ten minutes (FORETRACE_MINUTES) of a loop at its preset's rate, recorded, replayed bit for bit, and run again with five other laws,
# which must take less time than the recording. FORETRACE is the program (default: built here).
source "$(dirname "$0")/head.sh"
seconds=$((60 * ${FORETRACE_MINUTES:-10}))
program
start_daemon 43 --no-rights
start_arm

"$FORETRACE" record "$scratch/run.mcap" --seconds "$seconds" --json "$scratch/report.json" "${at[@]}" &
recorder=$!
style=1
words=(quick brown fox jumps over lazy dog)
while kill -0 "$recorder" 2>/dev/null; do
  # Another word by another hand each time, so that no law learns one by heart; after a stop the loop is armed again.
  "$FORETRACE" request arm "${at[@]}" >"$scratch/log" 2>&1 || true
  "$FORETRACE" play "glyphs:${words[style % ${#words[@]}]}" --style "$style" "${at[@]}" >"$scratch/log" 2>&1 &
  hand=$!
  while kill -0 "$hand" 2>/dev/null && kill -0 "$recorder" 2>/dev/null; do sleep 0.2; done
  kill -INT "$hand" 2>/dev/null || true
  wait "$hand" 2>/dev/null || true
  style=$((style + 1))
done
wait "$recorder"

"$FORETRACE" explain "$scratch/run.mcap"
"$FORETRACE" replay "$scratch/run.mcap" --json "$scratch/replay.json"
begin=$(date +%s)
"$FORETRACE" replay "$scratch/run.mcap" --json "$scratch/what-if.json" --picture "${FORETRACE_PICTURE:-$scratch/what-if.svg}" \
  --what-if predictor=hold --what-if predictor=dybm --what-if trust=0 --what-if trust=1 --what-if mpc.velocity_lead_ms=20
took=$(($(date +%s) - begin))

python3 - "$scratch" "$seconds" "$took" <<'PYTHON'
import json
import os
import sys

folder, seconds, took = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
read = lambda name: json.load(open(os.path.join(folder, name), encoding="utf-8"))
record, replay, what_if = read("report.json"), read("replay.json"), read("what-if.json")
lost = {key: record[key] for key in ("queue_lost", "inputs_lost", "ticks_lost", "things_broken") if record[key]}
rate = replay["ticks"] / max(replay["seconds"], 1e-9)
problems = []
if lost:
    problems.append(f"lost while recording: {lost}")
if replay["end"] != "of_recording" or replay["difference"] or not replay["same_build"]:
    problems.append(f"the replay: {replay}")
if replay["seconds"] < seconds - 3:
    problems.append(f"{replay['seconds']:.1f} s of {seconds} s were replayed")
if len(what_if["rows"]) != 7 or what_if["seconds"] < 0.9 * seconds:
    problems.append(f"{what_if['seconds']:.1f} s of {seconds} s were run with {len(what_if['rows'])} rows")
if took > seconds:
    problems.append(f"five variants took {took} s for {seconds} s")
size = os.path.getsize(os.path.join(folder, "run.mcap")) * 1e-6
for problem in problems:
    print(f"broken: {problem}")
if not problems:
    print(f"ok: {replay['ticks']} ticks at {rate:.0f} Hz in {size:.0f} MB, replayed bit for bit; five variants in {took} s")
sys.exit(bool(problems))
PYTHON
