#!/usr/bin/env bash
# Adds a recording of the present layouts to client/record/tests/kept, when a message has changed. FORETRACE is the program
# (default: built here).
set -euo pipefail
cd "$(dirname "$0")/../.."

scratch=$(mktemp -d)
children=()
finish() {
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$scratch"
}
trap finish EXIT

if [[ -z ${FORETRACE:-} ]]; then
  cargo build --locked -p foretrace
  FORETRACE=${CARGO_TARGET_DIR:-target}/debug/foretrace
fi
at=(--instance 42 --root "$scratch/i")
"$FORETRACE" daemon --no-rights "${at[@]}" 2>"$scratch/daemon.log" &
children+=($!)
until "$FORETRACE" status "${at[@]}" >"$scratch/log" 2>&1; do sleep 0.1; done
"$FORETRACE" arm sim "${at[@]}" >"$scratch/arm.log" 2>&1 &
children+=($!)
until "$FORETRACE" request arm "${at[@]}" >"$scratch/log" 2>&1; do sleep 0.1; done
"$FORETRACE" play glyphs:Kx "${at[@]}" >"$scratch/log" 2>&1 &
children+=($!)
sleep 1
"$FORETRACE" record "$scratch/run.mcap" --seconds 2 "${at[@]}"
cargo run --locked -p foretrace-record --example keep -- "$scratch/run.mcap" client/record/tests/kept
