#!/usr/bin/env bash
# The Python package as its users meet it: builds the wheel once with pip alone, installs it into fresh environments of
# each Python from 3.10 to 3.13 that is there, with and without numpy, `pip check`, and runs the tests beside a real
# daemon: messages, requests, pens, arms, faults, threads, every block of the documents, examples (ur_rtde and MuJoCo where
# they can be had). FORETRACE is the program (default: built here); FORETRACE_PYTHONS the Pythons, in words (default: found
# by name, and those of pyenv). What is missing is skipped and named, and so is a test that no environment could run.
# Arguments go to the tests: judge.sh -k Arms.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=$PWD/tests/python

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
skip() {
  echo "python: skipped, $*"
  exit 0
}

pythons=()
for version in 3.10 3.11 3.12 3.13; do
  for found in $(type -ap "python$version") "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$version".*/bin/python; do
    if [[ -x $found && $("$found" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) == "$version" ]]; then
      pythons+=("$found")
      break
    fi
  done
done
[[ -n ${FORETRACE_PYTHONS:-} ]] && read -ra pythons <<<"$FORETRACE_PYTHONS"
[[ ${#pythons[@]} -gt 0 ]] || skip "no Python from 3.10 to 3.13 is here"
command -v cargo >/dev/null || skip "no Rust toolchain is here"

if [[ -z ${FORETRACE:-} ]]; then
  cargo build --locked --quiet --bins -p foretrace
  FORETRACE=${CARGO_TARGET_DIR:-target}/debug/foretrace
fi
FORETRACE=$(realpath "$FORETRACE")
export FORETRACE

# The wheel: pip fetches maturin, and needs nothing else.
builder=$scratch/builder
"${pythons[0]}" -m venv "$builder" >"$scratch/log" 2>&1 || skip "${pythons[0]} makes no environments: $(tail -1 "$scratch/log")"
"$builder/bin/pip" download -q --no-deps --dest "$scratch/have" maturin==1.16.0 >"$scratch/log" 2>&1 ||
  skip "pip reaches no registry: $(tail -1 "$scratch/log")"
"$builder/bin/pip" wheel -q --no-deps --wheel-dir "$scratch/wheel" ./client/python >"$scratch/log" 2>&1 || {
  tail -40 "$scratch/log" >&2
  echo "python: the wheel is not built" >&2
  exit 1
}
wheel=$(ls "$scratch"/wheel/foretrace-*.whl)
echo "python: $(basename "$wheel"), $(($(stat -c %s "$wheel") / 1024)) kB"
[[ $wheel == *cp310-abi3-* ]] || {
  echo "python: the wheel is not one for all Pythons from 3.10 on" >&2
  exit 1
}

broken=0
: >"$scratch/ran"
: >"$scratch/left-out"
judge() { # NAME PYTHON PACKAGES... -- TESTS...
  local name=$1 python=$2 venv=$scratch/$1
  shift 2
  local packages=()
  while [[ $1 != -- ]]; do packages+=("$1") && shift; done
  shift
  "$python" -m venv "$venv"
  if [[ ${#packages[@]} -gt 0 ]] && ! "$venv/bin/pip" install -q --only-binary :all: "${packages[@]}" >"$scratch/log" 2>&1; then
    echo "python: skipped $name, ${packages[*]} cannot be had: $(tail -1 "$scratch/log")"
    return
  fi
  "$venv/bin/pip" install -q --no-index "$wheel" >"$scratch/log" 2>&1 && "$venv/bin/pip" check >"$scratch/log" 2>&1 || {
    echo "python: $name: the wheel does not install: $(tail -1 "$scratch/log")"
    broken=$((broken + 1))
    return
  }
  echo "python: $name: $("$venv/bin/python" --version)"
  # Away from the sources: only what is installed is found.
  local verdict=0
  (cd "$here" && "$venv/bin/python" -m unittest "$@" -v) >"$scratch/$name.tests" 2>&1 || verdict=$?
  # A test that one environment leaves out may run in another: who ran in none is named at the end.
  awk -v ran="$scratch/ran" -v left="$scratch/left-out" '
    /^test_[a-z0-9_]+ \(/ { name = $1 }
    /(^| )ok$/ { print name >>ran }
    /(^| )skipped / { reason = $0; sub(/.*skipped /, "", reason); print name, reason >>left }
  ' "$scratch/$name.tests"
  if [[ $verdict != 0 ]]; then
    cat "$scratch/$name.tests"
    broken=$((broken + 1))
  fi
  tail -3 "$scratch/$name.tests" | sed 's/skipped=/left out here: /'
}

for python in "${pythons[@]}"; do
  version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  judge "$version-numpy" "$python" numpy -- discover "$@"
done
judge "without-numpy" "${pythons[-1]}" -- discover "$@"
if [[ $# == 0 ]]; then
  judge zenoh "${pythons[0]}" eclipse-zenoh==1.10.2 tomli -- test_zenoh
  # Their wheels are for some Pythons only.
  eleven=()
  for python in "${pythons[@]}"; do
    [[ $("$python" -c 'import sys; print(sys.version_info[1])') == 11 ]] && eleven+=("$python")
  done
  [[ ${#eleven[@]} -gt 0 ]] || echo "python: skipped ur-rtde and mujoco, Python 3.11 is not here"
  for python in "${eleven[@]}"; do
    judge ur-rtde "$python" numpy ur_rtde==1.6.5 -- test_examples
    judge mujoco "$python" numpy mujoco==4.0.0 -- test_examples
    # An arm in lock-step needs no daemon; its test skips where MuJoCo could not be had, which was said above.
    if "$scratch/mujoco/bin/python" -c "import mujoco, foretrace" 2>/dev/null; then
      (cd client/python/tests && "$scratch/mujoco/bin/python" -m unittest test_lab.Physics) || broken=$((broken + 1))
    fi
  done
  judge types "${pythons[-1]}" mypy numpy tomli -- test_messages
  if [[ -x $scratch/types/bin/mypy ]]; then
    "$scratch/types/bin/mypy" --strict --python-version 3.10 -p foretrace || broken=$((broken + 1))
  fi
fi
# What needs no daemon: recordings, data sets, the law.
[[ $# == 0 ]] && { FORETRACE_WHEEL=$wheel client/python/tests/run.sh "${pythons[@]}" || broken=$((broken + 1)); }
if [[ $# == 0 ]]; then
  while read -r test reason; do
    grep -qx "$test" "$scratch/ran" || echo "python: skipped $test in every environment: $reason"
  done < <(sort -u "$scratch/left-out")
fi
echo "python: $broken claims broken"
[[ $broken == 0 ]]
