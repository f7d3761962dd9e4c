#!/usr/bin/env bash
# make_recording.sh FILE.mcap: nine seconds of a daemon whose simulated arm follows the built-in writer and is stopped.
# FORETRACE is the program.
file=$(realpath -m "$1")
source "$(dirname "${BASH_SOURCE[0]}")/../../../tests/record/head.sh"

program
start_daemon 77 --no-rights
"$FORETRACE" record "$file" --seconds 9 "${at[@]}" >"$scratch/record.log" 2>&1 &
recorder=$!
start_arm
"$FORETRACE" play glyphs:hello "${at[@]}" >"$scratch/play.log" 2>&1 &
children+=("$!")
sleep 6
"$FORETRACE" request stop "${at[@]}"
wait "$recorder" || { cat "$scratch/record.log"; exit 1; }
