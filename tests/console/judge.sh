#!/usr/bin/env bash
# The console in a real browser: tests/console/judge.sh [FOLDER for pictures, docs/pictures for those of the documents]. Needs a Chromium (Debian's package
# `chromium`, or CHROMIUM=/path), node 20 and npm; where one of them cannot be had, says so and leaves with 0. What needs
# no browser (words.mjs, clock.mjs) is judged first, with node alone.
# FORETRACE is the program (default: built here). Also makes three.bundle.js anew and compares it.
set -euo pipefail
cd "$(dirname "$0")/../.."
pictures=$(realpath -m "${1:-target/console-pictures}")
chromium=${CHROMIUM:-$(command -v chromium || true)}
if ! command -v node >/dev/null; then
  echo "console: skipped: node is not installed: neither the page's words and clock nor the page in a browser are judged"
  exit 0
fi
scratch=$(mktemp -d /tmp/ftc-XXXXXX)
trap 'rm -rf "$scratch"' EXIT
fetch() { (cd "$1" && npm ci --ignore-scripts --no-audit --no-fund --silent); }

mkdir "$scratch/bundle" "$scratch/page"
cp client/console/bundle/{package.json,package-lock.json,three.entry.js} "$scratch/bundle"
cp tests/console/{package.json,package-lock.json,clock.mjs,judge.mjs,others.mjs,screens.mjs,standing.mjs,words.mjs} "$scratch"
cp client/console/page/{clock,live,sheet}.js "$scratch/page"
node "$scratch/words.mjs"
node "$scratch/clock.mjs"

for tool in "$chromium" "$(command -v npm || true)"; do
  if [[ -z $tool || ! -x $tool ]]; then
    echo "console: skipped: a browser's judgement needs chromium, node and npm"
    exit 0
  fi
done
if ! fetch "$scratch/bundle" || ! fetch "$scratch"; then
  echo "console: skipped: npm cannot have the packages of the lock files here"
  exit 0
fi
(cd "$scratch/bundle" && npm run --silent bundle)
cmp "$scratch/page/three.bundle.js" client/console/page/three.bundle.js
echo "ok  three.bundle.js is what its lock file makes"

program=${FORETRACE:-target/release/foretrace}
if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --package foretrace --bin foretrace --locked
fi
more=$(realpath -m target/console-tall)
mkdir -p "$pictures" "$more"
CHROMIUM=$chromium PROGRAM=$(realpath "$program") SCRATCH=$scratch PICTURES=$pictures MORE_PICTURES=$more node "$scratch/judge.mjs"
