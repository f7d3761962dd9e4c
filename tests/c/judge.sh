#!/usr/bin/env bash
# libforetrace as its users meet it: installs it into a scratch folder, builds the examples in C11 and C++17 with all warnings as errors,
# by pkg-config and, where it is there, by CMake; makes wrong calls under the address and undefined-behaviour sanitizers; then lets the C and
# the C++ programs be pen, arm and monitor of a daemon. FORETRACE is the program (default: built here). Needs gcc; what else is missing
# (g++, clang, pkg-config, CMake) is skipped and named.
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$PWD
scratch=$(mktemp -d)
children=()
finish() {
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$scratch"
}
trap finish EXIT
fail() {
  echo "c: $*" >&2
  exit 1
}
there() { command -v "$1" >/dev/null || { echo "c: skipped, $1 is not installed: $2"; return 1; }; }

there gcc "nothing can be built" || exit 0
if [[ -z ${FORETRACE:-} ]]; then
  cargo build --locked --quiet -p foretrace
  FORETRACE=${CARGO_TARGET_DIR:-target}/debug/foretrace
fi
FORETRACE=$(realpath "$FORETRACE")
client/c/install "$scratch/prefix" --debug
"$FORETRACE" schema c | diff -q - client/c/include/foretrace/messages.h || fail "messages.h is not what 'foretrace schema c' prints"

export PKG_CONFIG_PATH=$scratch/prefix/lib/pkgconfig LD_LIBRARY_PATH=$scratch/prefix/lib
if there pkg-config "flags are given by hand"; then
  read -ra cflags < <(pkg-config --cflags foretrace)
  read -ra shared < <(pkg-config --libs foretrace)
else
  cflags=(-I"$scratch/prefix/include") shared=(-L"$scratch/prefix/lib" -lforetrace)
fi
static=("$scratch/prefix/lib/libforetrace.a" -lpthread -ldl -lm -lrt)
warnings=(-Wall -Wextra -Werror -pedantic -Wshadow -Wconversion)
c11=(-std=c11 -D_POSIX_C_SOURCE=200809L "${warnings[@]}" "${cflags[@]}")
cpp17=(-std=c++17 "${warnings[@]}" "${cflags[@]}")
languages=()
for compiler in gcc clang; do
  there "$compiler" "its warnings are not seen" || continue
  for source in client/c/examples/*.c; do
    "$compiler" "${c11[@]}" "$source" "${shared[@]}" -lm -o "$scratch/$(basename "$source" .c)-c"
  done
  [[ $compiler == gcc ]] && languages+=(c)
done
for compiler in g++ clang++; do
  there "$compiler" "its warnings are not seen" || continue
  for source in client/c/examples/*.cpp; do
    "$compiler" "${cpp17[@]}" "$source" "${static[@]}" -o "$scratch/$(basename "$source" .cpp)-cpp"
  done
  [[ $compiler == g++ ]] && languages+=(cpp)
done
if there g++ "the documents' programs are not built"; then
  # Every block of C++ in the documents, with a tablet that is gone at once. The process tests know of no other place for one.
  blocks=0
  while read -r page; do
    {
      echo 'static bool wait_for_my_tablet(double &x_m, double &y_m) { x_m = y_m = 0.0; return false; }'
      sed -n '/^```cpp$/,/^```$/p' "$page" | grep -v '^```'
    } >"$scratch/page.cpp"
    g++ "${cpp17[@]}" "$scratch/page.cpp" "${static[@]}" -o "$scratch/page"
    blocks=$((blocks + 1))
  done < <(grep -rl '^```cpp$' docs README.md)
  [[ $blocks -gt 0 ]] || fail "the documents have no C++ any more"
fi
sanitizers=(-fsanitize=address,undefined -fno-sanitize-recover=all)
if ! gcc "${sanitizers[@]}" -x c - -o "$scratch/sane" <<<'int main(void) { return 0; }' 2>/dev/null; then
  echo "c: skipped, gcc has no sanitizers here: wrong calls are made without them"
  sanitizers=()
fi
gcc "${c11[@]}" -g "${sanitizers[@]}" client/c/tests/hostile.c "${static[@]}" -o "$scratch/hostile"
if there cmake "its package is not tried"; then
  mkdir "$scratch/cmake"
  printf '%s\n' 'cmake_minimum_required(VERSION 3.13)' 'project(judge C)' 'find_package(foretrace 0.1 REQUIRED)' \
    "add_executable(monitor $root/client/c/examples/latency_monitor.c)" 'target_compile_definitions(monitor PRIVATE _POSIX_C_SOURCE=200809L)' \
    'target_link_libraries(monitor foretrace::static)' >"$scratch/cmake/CMakeLists.txt"
  cmake -S "$scratch/cmake" -B "$scratch/cmake/build" -DCMAKE_PREFIX_PATH="$scratch/prefix" >/dev/null
  cmake --build "$scratch/cmake/build" >/dev/null
fi

# A daemon of its own, away from any that this user runs.
export XDG_RUNTIME_DIR=$scratch/run
mkdir -m 700 "$XDG_RUNTIME_DIR"
run_daemon() {
  "$FORETRACE" daemon --no-rights --preset ur5 --set safety.joint_state_timeout_ms=500 >"$scratch/daemon.log" 2>&1 &
  daemon=$!
  children+=("$daemon")
  for _ in $(seq 100); do
    "$FORETRACE" status >/dev/null 2>&1 && return
    sleep 0.1
  done
  fail "the daemon does not come up: $(tail -1 "$scratch/daemon.log")"
}
end_daemon() {
  kill "$daemon"
  wait "$daemon" || true
}

"$scratch/hostile" || fail "wrong calls without a daemon"
run_daemon
"$scratch/hostile" 0 || fail "wrong calls beside a daemon"
end_daemon

for language in "${languages[@]}"; do
  run_daemon
  mkfifo "$scratch/wanted-$language"
  "$scratch/hardware_interface-$language" <"$scratch/wanted-$language" &
  arm=$!
  children+=("$arm")
  exec 3>"$scratch/wanted-$language"
  for attempt in $(seq 20); do
    "$FORETRACE" request arm >"$scratch/armed" 2>&1 && break
    [[ $attempt == 20 ]] && fail "$language: $(cat "$scratch/armed")"
    sleep 0.2
  done
  "$scratch/tablet_reader-$language" &
  pen=$!
  ticks=$("$scratch/latency_monitor-$language")
  echo "c: $language: $ticks"
  [[ $ticks == *"; following; "* ]] || fail "$language: the arm does not follow its pen"
  wait "$pen" || fail "$language: the pen"
  if [[ -x $scratch/predictor-$language ]]; then
    "$FORETRACE" request predictor external >/dev/null
    "$scratch/predictor-$language" >"$scratch/answered" &
    predictor=$!
    "$scratch/tablet_reader-$language" &
    pen=$!
    sleep 3
    taken=$("$FORETRACE" status --json | python3 -c 'import json, sys; print(json.load(sys.stdin)["predictor"]["external"]["taken"])')
    wait "$pen" || fail "$language: the pen"
    wait "$predictor" || fail "$language: the predictor"
    echo "c: $language: $(cat "$scratch/answered"), $taken previews taken in 3 s"
    [[ $taken -gt 50 ]] || fail "$language: previews are not taken"
  fi
  "$FORETRACE" request stop >/dev/null
  # The daemon dies and another one comes: the arm's program outlives the first.
  exec 3>&-
  wait "$arm" || fail "$language: the arm"
  end_daemon
done
echo "c: 0 claims broken"
