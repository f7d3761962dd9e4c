#!/usr/bin/env bash
# MuJoCo and Pinocchio judge the law in lock-step: tests/physics/judge.sh [RESULTS.json] [--only WORD] [--quick]. Makes a Python environment
# from PyPI in FORETRACE_PHYSICS_VENV (default: a scratch folder); where it cannot be had, says so and leaves with 0. FORETRACE is the
# program (default: built here); FORETRACE_DATA a folder with recorded hands, which are judged beside the built-in writer's.
set -euo pipefail
cd "$(dirname "$0")/../.."

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
if ! command -v python3 >/dev/null; then
  echo "physics: skipped, there is no python3"
  exit 0
fi
venv=$(realpath -m "${FORETRACE_PHYSICS_VENV:-$scratch/venv}")
if [[ ! -x $venv/bin/python ]] || ! "$venv/bin/python" -c 'import mujoco, pinocchio' 2>/dev/null; then
  if ! python3 -m venv "$venv" >"$scratch/log" 2>&1 ||
    ! timeout 900 "$venv/bin/pip" install -q --only-binary :all: mujoco==4.0.0 pin==4.1.0 numpy==2.4.6 >>"$scratch/log" 2>&1; then
    echo "physics: skipped, a Python environment with mujoco and pin cannot be had here: $(tail -1 "$scratch/log")"
    exit 0
  fi
fi
if [[ -z ${FORETRACE:-} ]]; then
  cargo build --release --locked -p foretrace
  FORETRACE=target/release/foretrace
fi
OMP_NUM_THREADS=1 "$venv/bin/python" tests/physics/judge.py "$(realpath "$FORETRACE")" "$@"
