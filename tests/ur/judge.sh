#!/usr/bin/env bash
# Clients that others wrote against `foretrace ur-sim`, at 125 and 500 Hz: ur_rtde, urx, urkit and
# universal-robots-clients, the last and ur_rtde also beside our bridge; what drivers do (driver.py: come back
# over a running script, a pendant's program, sockets, interpreter mode); then the control programs of others in
# the interpreter (that of the client library where FORETRACE_URCL names a checkout of it). Makes a Python
# environment from PyPI in FORETRACE_UR_VENV (default: a scratch folder); where it cannot be had, says so and
# leaves with 0. FORETRACE is the program (default: built here). Ports of a robot are fixed, so each simulator
# has an address of its own: 127.0.0.21 and 127.0.0.22.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=$PWD/tests/ur

scratch=$(mktemp -d)
simulators=()
finish() {
  for simulator in "${simulators[@]}"; do kill "$simulator" 2>/dev/null || true; done
  rm -rf "$scratch"
}
trap finish EXIT

venv=$(realpath -m "${FORETRACE_UR_VENV:-$scratch/venv}")
if [[ ! -x $venv/bin/python ]]; then
  if ! python3 -m venv "$venv" >"$scratch/log" 2>&1 ||
    ! timeout 600 "$venv/bin/pip" install -q --only-binary ur_rtde \
      ur_rtde==1.6.5 urkit==0.6.0 urx==0.11.0 universal-robots-clients==0.4.0 >>"$scratch/log" 2>&1; then
    echo "ur: skipped, a Python environment with ur_rtde cannot be had here: $(tail -1 "$scratch/log")"
    exit 0
  fi
fi

if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --locked -p foretrace
  FORETRACE=target/release/foretrace
fi
FORETRACE=$(realpath "$FORETRACE")

broken=0
for series in "cb3 125 127.0.0.21" "e 500 127.0.0.22"; do
  read -r name rate address <<<"$series"
  "$FORETRACE" ur-sim --series "$name" --bind "$address" &
  simulators+=($!)
  # Until its last port is open.
  for _ in $(seq 100); do
    (exec 3<>"/dev/tcp/$address/30090") 2>/dev/null && break
    sleep 0.1
  done
  for judge in sdu others driver; do
    # urkit leaves a log where it is started.
    (cd "$scratch" && timeout 300 "$venv/bin/python" "$here/$judge.py" "$address" "$rate") ||
      broken=$((broken + $?))
  done
  mkdir "$scratch/$name"
  timeout 300 "$venv/bin/python" "$here/beside.py" "$address" "$rate" "$FORETRACE" "$scratch/$name" ||
    broken=$((broken + $?))
done
"$venv/bin/python" client/ur-sim/tests/script/others.py "$scratch/scripts" ${FORETRACE_URCL:+"$FORETRACE_URCL"}
FORETRACE_UR_SCRIPTS=$scratch/scripts cargo test --locked -p foretrace-ur-sim --test script -- others:: ||
  broken=$((broken + 1))
echo "ur: $broken claims broken"
[[ $broken == 0 ]]
