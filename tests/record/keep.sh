#!/usr/bin/env bash
# Adds a recording of the present layouts to client/record/tests/kept, when a message has changed. FORETRACE is the program
# (default: built here).
source "$(dirname "$0")/head.sh"

program debug
start_daemon 42 --no-rights
start_arm
"$FORETRACE" play glyphs:Kx "${at[@]}" >"$scratch/log" 2>&1 &
children+=($!)
sleep 1
"$FORETRACE" record "$scratch/run.mcap" --seconds 2 "${at[@]}"
cargo run --locked -p foretrace-record --example keep -- "$scratch/run.mcap" client/record/tests/kept
