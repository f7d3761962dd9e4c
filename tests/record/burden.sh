#!/usr/bin/env bash
# What watching costs the loop: with a relay, a recorder, a flight recorder, metrics that are scraped and a server
# for viewers with two of them, against none of these. PAIRS (default 10) interleaved pairs of SECONDS_EACH
# (default 8) each. Tells the p99 of wake-up and step of every run and their ratios, whose median must be at most
# LIMIT (default 1.1; on a machine that does other work at the same time it means nothing). Without node and npm,
# which the viewers need, it says so and leaves with 0. FORETRACE is the program (default: built here).
source "$(dirname "$0")/head.sh"
npm_packages
program
cat >"$scratch/viewer.mjs" <<'END'
import WebSocket from "ws";
const socket = new WebSocket(`ws://${process.argv[2]}`, ["foxglove.sdk.v1"]);
let count = 0;
const subscriptions = [1, 2, 3].map((id) => ({ id, channelId: id }));
socket.on("open", () => socket.send(JSON.stringify({ op: "subscribe", subscriptions })));
socket.on("message", () => count++);
process.on("SIGTERM", () => { console.log(count); process.exit(0); });
END

# One run: a daemon of its own, an arm, a writing hand; prints its status as JSON at the end.
run() {
  local watched=$1 number=$2 mine daemon arm foxglove address
  start_daemon 44
  start_arm
  mine=("$arm")
  if [[ $watched == watched ]]; then
    "$FORETRACE" relay "${at[@]}" >"$scratch/relay.log" 2>&1 &
    mine+=($!)
    try "no relay" test -S "$scratch/i/relay.sock"
    "$FORETRACE" record "$scratch/run-$number.mcap" "${at[@]}" >"$scratch/record.log" 2>&1 &
    mine+=($!)
    "$FORETRACE" flight "$scratch/box" "${at[@]}" >"$scratch/flight.log" 2>&1 &
    mine+=($!)
    "$FORETRACE" metrics --listen 127.0.0.1:0 "${at[@]}" 2>"$scratch/metrics.log" &
    mine+=($!)
    start_foxglove
    mine+=("$foxglove")
    try "no metrics" grep -q /metrics "$scratch/metrics.log"
    local target viewer
    target=$(sed -n 's|.*http://\([^/]*\)/metrics.*|\1|p' "$scratch/metrics.log")
    for viewer in 1 2; do
      node "$scratch/viewer.mjs" "$address" >"$scratch/viewer-$viewer" &
      mine+=($!)
    done
    (while sleep 2; do curl -s "http://$target/metrics" >"$scratch/scraped" || true; done) &
    mine+=($!)
  fi
  children+=("${mine[@]}")
  timeout "${SECONDS_EACH:-8}" "$FORETRACE" play glyphs:Kxabcdefgh "${at[@]}" >"$scratch/log" 2>&1 || true
  "$FORETRACE" status --json - "${at[@]}" >"$scratch/$watched-$number.json" 2>"$scratch/log"
  for child in "${mine[@]}"; do kill -TERM "$child" 2>/dev/null || true; done
  for child in "${mine[@]}"; do wait "$child" 2>/dev/null || true; done
  kill -INT "$daemon"
  wait "$daemon" 2>/dev/null || true
  children=()
  if [[ $watched == watched ]]; then
    cat "$scratch/viewer-1" "$scratch/viewer-2" >>"$scratch/viewers"
    rm -rf "$scratch/run-$number.mcap"* "$scratch/box"
  fi
}

for number in $(seq "${PAIRS:-10}"); do
  # Either may come first.
  if ((number % 2)); then run alone "$number"; run watched "$number"; else run watched "$number"; run alone "$number"; fi
done
python3 - "$scratch" "${PAIRS:-10}" "${LIMIT:-1.1}" <<'END'
import json, statistics, sys

folder, pairs, limit = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
load = lambda kind, number: {name: stage["p99"] for name, stage in json.load(open(f"{folder}/{kind}-{number}.json"))["stage_us"].items()}
runs = [(load("alone", number), load("watched", number)) for number in range(1, pairs + 1)]
broken = False
for stage in ("wakeup", "step"):
    ratios = [watched[stage] / alone[stage] for alone, watched in runs]
    median = statistics.median(ratios)
    print(f"{stage}: p99 alone {sorted(round(a[stage], 1) for a, _ in runs)} µs")
    print(f"{stage}: p99 watched {sorted(round(w[stage], 1) for _, w in runs)} µs")
    print(f"{stage}: median ratio {median:.3f}, from {min(ratios):.3f} to {max(ratios):.3f} in {pairs} pairs")
    broken |= median > limit
seen = [int(line) for line in open(f"{folder}/viewers")]
print(f"viewers got {min(seen)} to {max(seen)} messages each")
print("WRONG: watching costs more than is promised" if broken else "ok: watching costs the loop at most what is promised")
sys.exit(broken)
END
