# What the scripts of this folder have in common; each sources it first. Gives a scratch folder, `children` that end
# with the script, the program (FORETRACE, default: built here), and a daemon with an armed arm that is simulated.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
scratch=$(mktemp -d /tmp/ftr-XXXXXX)
children=()
finish() {
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$scratch"
}
trap finish EXIT

# skip WORDS: what the script needs cannot be had here.
skip() {
  echo "$(basename "$0" .sh): skipped: $1"
  exit 0
}

# try WORDS COMMAND...: until the command succeeds, for ten seconds and more.
try() {
  local words=$1
  shift
  for _ in $(seq 100); do
    "$@" >"$scratch/log" 2>&1 && return
    sleep 0.1
  done
  echo "$(basename "$0" .sh): $words: $(tail -3 "$scratch/log")"
  cat "$scratch"/*.log
  return 1
}

# program [debug]: the program under test, as a path that stays right.
program() {
  local profile=${1:-release}
  if [[ -z ${FORETRACE:-} ]]; then
    if [[ $profile == release ]]; then cargo build --release --locked -p foretrace; else cargo build --locked -p foretrace; fi
    FORETRACE=${CARGO_TARGET_DIR:-target}/$profile/foretrace
  fi
  FORETRACE=$(realpath "$FORETRACE")
}

# start_daemon NUMBER [OPTIONS...]: `at` are the options of its instance, `daemon` is its process.
start_daemon() {
  at=(--instance "$1" --root "$scratch/i")
  "$FORETRACE" daemon "${@:2}" "${at[@]}" 2>"$scratch/daemon.log" &
  daemon=$!
  children+=("$daemon")
  try "no daemon" "$FORETRACE" status "${at[@]}"
}

# start_arm: a simulated one, armed; `arm` is its process.
start_arm() {
  "$FORETRACE" arm sim "${at[@]}" >"$scratch/arm.log" 2>&1 &
  arm=$!
  children+=("$arm")
  try "the arm cannot be armed" "$FORETRACE" request arm "${at[@]}"
}

# npm_packages FILES...: the packages of the lock file and these files in the scratch folder.
npm_packages() {
  for tool in node npm; do
    command -v "$tool" >/dev/null || skip "the clients of others need node and npm"
  done
  cp tests/record/foxglove/{package.json,package-lock.json} "$@" "$scratch"
  (cd "$scratch" && npm ci --ignore-scripts --no-audit --no-fund --silent) >"$scratch/log" 2>&1 ||
    skip "npm cannot have the packages of the lock file here"
}

# start_foxglove [OPTIONS...]: `address` is where it listens, `foxglove` its process.
start_foxglove() {
  "$FORETRACE" foxglove --listen 127.0.0.1:0 "${at[@]}" "$@" >"$scratch/told" 2>"$scratch/foxglove.log" &
  foxglove=$!
  children+=("$foxglove")
  try "no server for viewers" grep -q token= "$scratch/told"
  address=$(sed -n 's|^open ws://\([^ ]*\) .*|\1|p' "$scratch/told")
}
