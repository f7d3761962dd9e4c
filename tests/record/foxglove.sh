#!/usr/bin/env bash
# `foretrace foxglove` by clients of others: npm's @foxglove/ws-protocol and one of foxglove.sdk.v1, beside one that
# never reads. Needs node 20 and npm; where they or the packages cannot be had, says so and leaves with 0. FORETRACE
# is the program (default: built here).
set -euo pipefail
cd "$(dirname "$0")/../.."
for tool in node npm; do
  if ! command -v "$tool" >/dev/null; then
    echo "foxglove: skipped: the clients of others need node and npm"
    exit 0
  fi
done
scratch=$(mktemp -d /tmp/ftf-XXXXXX)
children=()
finish() {
  for child in "${children[@]}"; do kill -INT "$child" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$scratch"
}
trap finish EXIT
cp tests/record/foxglove/{package.json,package-lock.json,judge.mjs} "$scratch"
if ! (cd "$scratch" && npm ci --ignore-scripts --no-audit --no-fund --silent) >"$scratch/log" 2>&1; then
  echo "foxglove: skipped: npm cannot have the packages of the lock file here"
  exit 0
fi

if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --locked -p foretrace
  FORETRACE=target/release/foretrace
fi
FORETRACE=$(realpath "$FORETRACE")
at=(--instance 42 --root "$scratch/i")
"$FORETRACE" daemon --no-rights "${at[@]}" 2>"$scratch/daemon.log" &
children+=($!)
for _ in $(seq 100); do
  "$FORETRACE" status "${at[@]}" >"$scratch/log" 2>&1 && break
  sleep 0.1
done
"$FORETRACE" arm sim "${at[@]}" >"$scratch/arm.log" 2>&1 &
children+=($!)
for _ in $(seq 100); do
  "$FORETRACE" request arm "${at[@]}" >"$scratch/log" 2>&1 && break
  sleep 0.1
done
"$FORETRACE" foxglove --listen 127.0.0.1:0 "${at[@]}" --json "$scratch/tally.json" >"$scratch/told" 2>"$scratch/foxglove.log" &
server=$!
children+=("$server")
for _ in $(seq 100); do
  grep -q token= "$scratch/told" && break
  sleep 0.1
done
address=$(sed -n 's|^open ws://\([^ ]*\) .*|\1|p' "$scratch/told")
[[ -n $address ]] || { cat "$scratch/foxglove.log"; exit 1; }
ADDRESS=$address node "$scratch/judge.mjs"
mode=$("$FORETRACE" status "${at[@]}" --json - 2>"$scratch/log" | sed -n 's/.*"mode": *"\([a-z]*\)".*/\1/p' | head -1)
if [[ $mode != stopped ]]; then
  echo "WRONG the service stopped the arm: mode $mode"
  exit 1
fi
echo "ok  the daemon says that the arm is stopped"
kill -INT "$server"
wait "$server" || true
cat "$scratch/tally.json"
