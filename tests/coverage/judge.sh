#!/usr/bin/env bash
# crepes (conformal prediction) judges the 50 and 90 % error bands of `mixture`: tests/coverage/judge.sh [FOLDER...]. FOLDER: data sets with the parts
# train and test (default: a generated set). Makes a Python environment from PyPI in FORETRACE_COVERAGE_VENV (default: a scratch folder); where
# it cannot be had, says so and leaves with 0. FORETRACE is the program (default: built here).
set -euo pipefail
cd "$(dirname "$0")/../.."

# crepes asks for scikit-learn only when it is imported.
packages=(crepes==0.9.1 scikit-learn==1.9.1 numpy==2.4.6 scipy==1.17.1 pandas==3.1.1)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
if ! command -v python3 >/dev/null; then
  echo "coverage: skipped, there is no python3"
  exit 0
fi
venv=$(realpath -m "${FORETRACE_COVERAGE_VENV:-$scratch/venv}")
if [[ ! -x $venv/bin/python ]] || ! "$venv/bin/python" -c 'import crepes' 2>/dev/null; then
  if ! python3 -m venv "$venv" >"$scratch/log" 2>&1 ||
    ! timeout 900 "$venv/bin/pip" install -q --only-binary :all: "${packages[@]}" >>"$scratch/log" 2>&1 ||
    ! "$venv/bin/python" -c 'import crepes' >>"$scratch/log" 2>&1; then
    echo "coverage: skipped, a Python environment with crepes cannot be had here: $(tail -1 "$scratch/log")"
    exit 0
  fi
fi
if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --locked -p foretrace
  FORETRACE=${CARGO_TARGET_DIR:-target}/release/foretrace
fi
FORETRACE=$(realpath "$FORETRACE")
if (($# == 0)); then
  "$FORETRACE" lab generate "$scratch/generated" --writers 16 >/dev/null
  set -- "$scratch/generated"
fi
for folder in "$@"; do
  "$venv/bin/python" tests/coverage/judge.py "$FORETRACE" "$folder" "$scratch"
done
