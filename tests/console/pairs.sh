#!/usr/bin/env bash
# What a console and a scripted client cost the loop: tests/console/pairs.sh [PAIRS, 10] [SECONDS each, 20]. For a quiet
# machine: it prints wake-up and step p99 without -> with, pair by pair in turn, and the medians of their ratios.
# Needs node 20; FORETRACE is the program (default: built here).
set -euo pipefail
cd "$(dirname "$0")/../.."
if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --package foretrace --bin foretrace --locked
fi
scratch=$(mktemp -d /tmp/ftc-XXXXXX)
trap 'rm -rf "$scratch"' EXIT
PROGRAM=$(realpath "${FORETRACE:-target/release/foretrace}") SCRATCH=$scratch node tests/console/pairs.mjs "$@"
