#!/usr/bin/env bash
# The recipe of docs/extend/shards.md for GNU parallel, on a small set: eight shards, and their merge, which is the run that is not
# cut. FORETRACE=PROGRAM takes that program and builds none. Without GNU parallel it is said as "skipped:".
set -euo pipefail
cd "$(dirname "$0")/../.."
command -v parallel >/dev/null && parallel --version 2>/dev/null | grep -q GNU || { echo "skipped: parallel: there is no GNU parallel"; exit 0; }
program=${FORETRACE:-}
if [[ -z $program ]]; then
  cargo build --release --locked --package foretrace
  program=${CARGO_TARGET_DIR:-$PWD/target}/release/foretrace
fi
recipe=$(sed -n '/^## GNU parallel/,/^## /p' docs/extend/shards.md | sed -n '/^```/,/^```/p' | grep -v '^```')
[[ $recipe == *parallel*"foretrace lab merge"* ]] || { echo "docs/extend/shards.md has no recipe" >&2; exit 1; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/bin" "$scratch/unipen-tos"
ln -s "$(realpath "$program")" "$scratch/bin/foretrace"
for writer in 0 1 2 3; do
  python3 - "$writer" >"$scratch/unipen-tos/w$writer.dat" <<'PY'
import math
import sys

writer = int(sys.argv[1])
print(".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 50\n.Y_POINTS_PER_MM 50\n.HIERARCHY CHARACTER")
for _ in range(2):
    print(".PEN_DOWN")
    for i in range(60):
        angle = 0.1 * i * (1 + 0.1 * writer)
        print(f"{90 * math.cos(angle) + 2 * i:.0f} {90 * math.sin(angle):.0f}")
    print(".PEN_UP")
for character in range(2):
    print(f'.WRITER_ID w{character}\n.SEGMENT CHARACTER {character} OK "o"')
PY
done
export PATH="$scratch/bin:$PATH" PARALLEL_HOME="$scratch"
cd "$scratch"
foretrace lab closed-loop --data unipen-tos --json whole.json >/dev/null
bash -euc "$recipe"
foretrace lab merge part-*.json --out merged --json merged.json >/dev/null
cmp whole.json merged.json
echo "parallel: everything passed"
