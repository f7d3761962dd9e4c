#!/usr/bin/env bash
# `foretrace foxglove` by clients of others: npm's @foxglove/ws-protocol and one of foxglove.sdk.v1, beside one that
# never reads. Needs node 20 and npm; where they or the packages cannot be had, says so and leaves with 0. FORETRACE
# is the program (default: built here).
source "$(dirname "$0")/head.sh"
npm_packages tests/record/foxglove/judge.mjs
program
start_daemon 42 --no-rights
start_arm
start_foxglove --json "$scratch/tally.json"
"$FORETRACE" play glyphs:Kx "${at[@]}" >"$scratch/play.log" 2>&1 &
children+=($!)
ADDRESS=$address node "$scratch/judge.mjs"
mode=$("$FORETRACE" status "${at[@]}" --json - 2>"$scratch/log" | sed -n 's/.*"mode": *"\([a-z]*\)".*/\1/p' | head -1)
if [[ $mode != stopped ]]; then
  echo "WRONG the service stopped the arm: mode $mode"
  exit 1
fi
echo "ok  the daemon says that the arm is stopped"
kill -INT "$foxglove"
wait "$foxglove" || true
cat "$scratch/tally.json"
