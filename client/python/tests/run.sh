#!/usr/bin/env bash
# run.sh [PYTHON...]: builds package, program and the Rust side of the law's tests, and runs all tests in fresh
# environments, with and without numpy, for every PYTHON (default: python3). FORETRACE (the program), FORETRACE_WHEEL
# (a wheel) and FORETRACE_LAW_BITS are built here unless they are given; FORETRACE_DATA is a folder of data sets.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
pythons=("$@")
[[ ${#pythons[@]} -gt 0 ]] || pythons=(python3)
scratch=$(mktemp -d /tmp/ftr-py-XXXXXX)
trap 'rm -rf "$scratch"' EXIT
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/../../target}

if [[ -z ${FORETRACE:-} ]]; then
  (cd ../.. && cargo build --locked -p foretrace --bins)
  FORETRACE=$CARGO_TARGET_DIR/debug/foretrace
fi
if [[ -z ${FORETRACE_WHEEL:-} ]]; then
  "${pythons[0]}" -m venv "$scratch/build"
  "$scratch/build/bin/pip" -q install maturin==1.16.0
  "$scratch/build/bin/maturin" build --release --locked --out "$scratch/wheels"
  FORETRACE_WHEEL=$(echo "$scratch"/wheels/*.whl)
fi
if [[ -z ${FORETRACE_LAW_BITS:-} ]]; then
  cargo build --release --locked --features pyo3/extension-module --example law_bits
  FORETRACE_LAW_BITS=$CARGO_TARGET_DIR/release/examples/law_bits
fi
FORETRACE=$(realpath "$FORETRACE")
export FORETRACE FORETRACE_LAW_BITS
if [[ -z ${FORETRACE_RECORDING:-} ]]; then
  tests/make_recording.sh "$scratch/run.mcap"
  export FORETRACE_RECORDING=$scratch/run.mcap
fi

failed=0
for python in "${pythons[@]}"; do
  for extra in "" numpy; do
    venv=$scratch/venv-$(basename "$python")-${extra:-plain}-$RANDOM
    "$python" -m venv "$venv"
    "$venv/bin/pip" -q install "$FORETRACE_WHEEL" ${extra:+"$extra"}
    "$venv/bin/pip" -q check
    echo "== $("$venv/bin/python" --version), ${extra:-without numpy}"
    tests=(test_recordings test_datasets test_law test_lab test_page)
    (cd tests && "$venv/bin/python" -W error::ResourceWarning -m unittest -v "${tests[@]}") >"$scratch/log" 2>&1 || {
      cat "$scratch/log"
      failed=1
    }
    tail -3 "$scratch/log"
    # Both ways of numpy run here; MuJoCo has its own environment in tests/python/judge.sh.
    grep '\.\.\. skipped ' "$scratch/log" | grep -v "numpy is \(not \)\?installed\|mujoco is not installed" | sed 's/^/python: /' || true
  done
done
exit "$failed"
