#!/usr/bin/env bash
# Recordings read by software of others: the Python packages of MCAP, protobuf and Perfetto, and Rerun; and
# recorders that are killed (KILLS, default 20), whose files pymcap-cli recovers too. Makes a Python environment from PyPI in FORETRACE_RECORD_VENV
# (default: a scratch folder); what cannot be had is said, and the script leaves with 0. FORETRACE is the
# program (default: built here).
source "$(dirname "$0")/head.sh"
here=$PWD/tests/record

venv=$(realpath -m "${FORETRACE_RECORD_VENV:-$scratch/venv}")
if [[ ! -x $venv/bin/python ]]; then
  if ! python3 -m venv "$venv" >"$scratch/log" 2>&1 ||
    ! timeout 600 "$venv/bin/pip" install -q mcap==1.6.0 mcap-protobuf-support==0.6.0 perfetto pymcap-cli==0.34.0 >>"$scratch/log" 2>&1; then
    skip "a Python environment with mcap cannot be had here: $(tail -1 "$scratch/log")"
  fi
fi

program
start_daemon 41 --no-rights
start_arm
"$FORETRACE" record "$scratch/run.mcap" --seconds 6 "${at[@]}" --json "$scratch/report.json" &
recorder=$!
"$FORETRACE" play glyphs:Kx "${at[@]}" >"$scratch/log" 2>&1
wait "$recorder"
"$FORETRACE" record --info "$scratch/run.mcap" --json "$scratch/info.json" >"$scratch/log"

broken=0
"$venv/bin/python" "$here/readers.py" "$scratch/run.mcap" "$scratch/info.json" "$scratch/report.json" ||
  broken=$((broken + 1))
"$FORETRACE" replay "$scratch/run.mcap" || broken=$((broken + 1))

"$FORETRACE" flight "$scratch/box" --keep 2 --seconds 8 "${at[@]}" 2>"$scratch/flight.log" &
flight=$!
"$FORETRACE" play glyphs:Kx "${at[@]}" >"$scratch/log" 2>&1 &
children+=($!)
sleep 3
kill -USR1 "$flight"
wait "$flight"
for trace in "$scratch"/box/*-request.perfetto-trace; do
  "$venv/bin/python" "$here/trace.py" "$trace" || broken=$((broken + 1))
done
"$venv/bin/python" "$here/kills.py" "$FORETRACE" "${KILLS:-20}" "$scratch" "${at[@]}" || broken=$((broken + 1))

if [[ ! -x $venv/bin/rerun ]] && ! timeout 600 "$venv/bin/pip" install -q --only-binary :all: rerun-sdk >"$scratch/log" 2>&1; then
  echo "record: Rerun skipped, its wheel cannot be had here: $(tail -1 "$scratch/log")"
elif "$venv/bin/rerun" mcap check "$scratch/run.mcap" >"$scratch/log" 2>&1; then
  echo "ok: rerun mcap check"
else
  echo "broken: rerun mcap check: $(tail -3 "$scratch/log")"
  broken=$((broken + 1))
fi
echo "record: $broken claims broken"
[[ $broken == 0 ]]
