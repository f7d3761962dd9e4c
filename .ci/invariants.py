"""Checks the invariants that ARCHITECTURE.md states and that a compiler does not. Exits non-zero with file and line."""

import json
import pathlib
import re
import subprocess
import sys

import documents
import tables

ROOT = pathlib.Path(__file__).resolve().parent.parent
OUR_FOLDERS = {"daemon", "client", "shm-schema", "config", "tests"}
UNSAFE_FILES = {"daemon/src/rt/os.rs", "daemon/src/alloc_count.rs", "shm-schema/src/os.rs", "client/cli/src/os.rs", "client/c/src/exports.rs",
                "client/c/src/predict.rs", "client/c/src/pointers.rs"}
# Rooms inside a crate (source folder: its modules in order): each names only those before it. Others are not checked.
ROOMS = {
    "shm-schema/src": ["os", "wire", "instance", "transport"],
    "daemon/control/src": [
        "state", "history", "units", "plane", "geometry", "stop", "pen", "predict", "learn", "estimate", "trust", "reference", "arm", "qp", "mpc",
        "envelope", "clearance", "ik", "guard", "monitor", "contact", "follower", "ghost", "extent",
    ],
    "daemon/src": [
        "alloc_count", "wire", "ports", "rt", "learner", "ipc", "limits", "memory", "options", "error", "law_rehearsal", "reload", "stop_socket",
        "supervisor", "log",
    ],
    "client/host/src": ["whole", "sha256", "calendar", "children"],
    "client/record/src": [
        "proto", "topics", "scene", "write", "read", "table", "pen", "repair", "info", "figures", "explain", "law", "replay", "verdict", "modelled",
        "stretch", "score", "what_if", "picture", "page",
    ],
    "client/live/src": ["source", "news", "relay", "recorder", "record_button", "trace", "flight", "last_flight", "stages", "metrics", "foxglove"],
    "client/doctor/src": [
        "bounded", "machine", "finding", "kernel", "rights", "cpu", "load", "memory", "leftovers", "rehearsal", "torque", "robot",
    ],
    "client/report/src": ["failures", "extent", "ghost", "stopped", "status", "run"],
    "client/arm/src": [
        "spin_watch", "priority", "ports", "refused", "judge", "intake", "agreement", "joint_log", "report", "guide",
        "sim", "ur",
    ],
    "client/calibrate/src": ["motion", "same_tool", "listener", "lag_report", "picture", "lag", "plane"],
    "client/gateway/src": ["holder", "socket", "tally", "serve"],
    "client/python/src": ["problem", "live", "files", "law"],
    "client/serve/src": ["peers", "metered", "http", "guard", "websocket", "frames", "admission"],
    "client/console/src": [
        "certificate", "wire", "keys", "page", "message", "board", "scene", "frame", "hold", "orders", "stops", "hand",
        "link", "session", "server", "lan",
    ],
    "client/ur/src": ["rtde", "primary", "dashboard", "series", "bridge"],
    "client/ur-sim/src": [
        "pose", "script", "options", "kinematics", "branches", "inverse", "motion", "safety", "inputs", "current", "setup", "robot", "names",
        "sockets", "machine", "motion_calls", "io_calls", "setup_calls", "socket_calls",
        "arrival", "outbox", "statements", "world", "applied", "interpreter", "outputs", "rtde_server", "streams", "dashboard_server", "trouble", "faults", "network", "listen",
        "control", "echo",
    ],
}
# Columns of a line of Rust, and the files whose long lines are data: strokes, style sheets, the documents' snippets.
WIDTH = 110
LONG_LINES = {
    "client/sim/src/writer/glyphs.rs", "client/sim/src/plot/sheet.rs",
    "tests/tests/processes/snippets.rs",
}
# 400 lines are the sign that a file may be about two things; more than this is refused.
MOST_LINES = 500
# Different tests that documents name; it may grow.
LEAST_PROMISED = 145
problems: list[str] = []


def sources(folder: str) -> list[pathlib.Path]:
    # The Python package is a workspace of its own, and builds below itself.
    return sorted(path for path in (ROOT / folder).rglob("*.rs") if "target" not in path.relative_to(ROOT).parts)


def nowhere_but(pattern: str, folder: str, allowed: set[str], claim: str) -> None:
    """`pattern` occurs in no code line below `folder`, tests aside, but in the allowed files."""
    for path in sources(folder):
        name = str(path.relative_to(ROOT))
        if name in allowed or "/tests" in name or "/examples/" in name:
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if not line.lstrip().startswith("//") and re.search(pattern, line):
                problems.append(f"{name}:{number}: {claim}")


def cargo(*arguments: str) -> str:
    return subprocess.run(["cargo", *arguments, "--locked"], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def control_reaches_no_outside_world() -> None:
    tree = cargo("tree", "-p", "foretrace-control", "-e", "normal", "--prefix", "none")
    names = {line.split()[0] for line in tree.splitlines() if line.strip()}
    for banned in sorted(names & {"clarabel", "iceoryx2", "tokio", "crossbeam", "rtrb", "tracing", "rustix", "rand"}):
        problems.append(f"foretrace-control reaches {banned}: the control law must stay pure")
    nowhere_but(
        r"std::(time|thread|fs|net|process|env|io)\b|\be?print(ln)?!|\b(Instant|SystemTime)\b",
        "daemon/control/src",
        set(),
        "the control law knows no clock, thread, file, socket, environment or output",
    )


def layers_point_downwards() -> None:
    below = {
        "foretrace-shm": set(),
        "foretrace-control": set(),
        "foretrace-clarabel": {"foretrace-control"},
        "foretrace-config": {"foretrace-clarabel", "foretrace-control"},
        "foretraced": {"foretrace-shm", "foretrace-config", "foretrace-control"},
        "foretrace-client": {"foretrace-shm"},
        "foretrace-c": {"foretrace-shm", "foretrace-client"},
        "foretrace-serve": {"foretrace-shm"},
        "foretrace-failure": set(),
        "foretrace-host": set(),
        "foretrace-gateway": {"foretrace-failure", "foretrace-serve", "foretrace-shm"},
        "foretrace-shapes": {"foretrace-config", "foretrace-control"},
        "foretrace-sim": {"foretrace-failure", "foretrace-host", "foretrace-config", "foretrace-control"},
        "foretrace-tablet": {"foretrace-failure", "foretrace-client", "foretrace-config"},
        "foretrace-console": {"foretrace-failure", "foretrace-client", "foretrace-serve", "foretrace-config", "foretrace-control"},
        "foretrace-ur": {"foretrace-config", "foretrace-control", "foretrace-client"},
        "foretrace-ur-sim": {"foretrace-config", "foretrace-control", "foretrace-sim", "foretrace-ur"},
        "foretrace-record": {"foretrace-host", "foretrace-shm", "foretrace-config", "foretrace-control", "foretraced", "foretrace-sim"},
        "foretrace-live": {"foretrace-host", "foretrace-shm", "foretrace-client", "foretrace-serve", "foretrace-control", "foretrace-record"},
        "foretrace-report": {
            "foretrace-failure", "foretrace-shm", "foretrace-client", "foretrace-config", "foretrace-control", "foretrace-sim", "foretrace-record",
            "foretrace-live",
        },
        "foretrace-arm": {
            "foretrace-failure", "foretrace-shm", "foretrace-client", "foretrace-config", "foretrace-control", "foretraced", "foretrace-sim",
            "foretrace-ur", "foretrace-report",
        },
        "foretrace-bench": {"foretrace-clarabel", "foretrace-failure", "foretrace-host", "foretrace-config", "foretrace-control", "foretrace-sim"},
        "foretrace-calibrate": {
            "foretrace-failure", "foretrace-host", "foretrace-client", "foretrace-config", "foretrace-control", "foretraced", "foretrace-sim",
            "foretrace-report",
        },
        "foretrace-doctor": {"foretrace-failure", "foretrace-shm", "foretrace-client", "foretrace-config", "foretraced", "foretrace-sim", "foretrace-ur"},
        "foretrace-lab": {"foretrace-failure", "foretrace-host", "foretrace-config", "foretrace-control", "foretrace-sim"},
    }
    for package in json.loads(cargo("metadata", "--format-version", "1", "--no-deps"))["packages"]:
        wanted = {d["name"] for d in package["dependencies"] if d["kind"] is None and d["name"].startswith("foretrace")}
        if package["name"] in {"foretrace", "foretrace-tests", "foretrace-loom"}:
            continue
        if package["name"] not in below:
            problems.append(f"{package['name']} has no place among the layers of .ci/invariants.py")
        extra = wanted - below.get(package["name"], wanted)
        if extra:
            problems.append(f"{package['name']} depends on {sorted(extra)}, which is not a layer below it")


def rooms_point_downwards() -> None:
    """No file of a room of ROOMS has a path to a later one, tests aside."""
    for folder, rooms in ROOMS.items():
        # A name that lib.rs takes out of a room counts as that room: `crate::Name` is no way around.
        library = (ROOT / folder / "lib.rs").read_text(encoding="utf-8")
        taken = re.findall(r"^(?:pub(?:\(crate\))? )?use (\w+)::([^;]*);", library, re.MULTILINE)
        room_of = {name: room for room, names in taken if room in rooms for name in re.findall(r"\w+", names)}
        room_of |= {room: room for room in rooms}
        for room in rooms:
            if not re.search(rf"^(?:pub(?:\(crate\))? )?mod {room};", library, re.MULTILINE):
                problems.append(f"{folder}/lib.rs has no module {room}, which is a room of .ci/invariants.py")
        inside = re.sub(r"^#\[cfg\(test\)\]\n(?:#.*\n)*.*$", "", library, flags=re.MULTILINE)
        for module in re.findall(r"^(?:pub(?:\(crate\))? )?mod (\w+);", inside, re.MULTILINE):
            if module not in rooms:
                problems.append(f"{folder}/lib.rs has the module {module}, which is no room of .ci/invariants.py")
        for path in sources(folder):
            name, parts = str(path.relative_to(ROOT)), path.relative_to(ROOT / folder).with_suffix("").parts
            if parts[0] not in rooms or "/tests" in name:
                continue
            text = re.sub(r"^[ \t]*//.*$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
            text = re.split(r"^#\[cfg\(test\)\]\n(?:#.*\n)*(?:pub(?:\(crate\))? )?mod \w+ \{", text, flags=re.MULTILINE)[0]
            depth = len(parts) - (parts[-1] == "mod")
            to_root = rf"(?<!\w)(?<!super::)(?:crate|super(?:::super){{{depth - 1}}})::(?=(\{{)|(\w+))"
            for found in re.finditer(to_root, text):
                inside, before = text[found.end() + 1 :], None
                while found[1] and inside != before:
                    before, inside = inside, re.sub(r"\{[^{}]*\}", "", inside)
                named = re.findall(r"(?:^|,)\s*(\w+)", inside.split("}")[0]) if found[1] else [found[2]]
                for other in named:
                    if other in room_of and rooms.index(room_of[other]) > rooms.index(parts[0]):
                        line = text.count("\n", 0, found.start()) + 1
                        problems.append(f"{name}:{line}: {parts[0]} names {room_of[other]}, which is a later room")


def lines_are_short() -> None:
    """No line of Rust beyond 110 columns. Text between quotes (test data, style sheets) and the tables of strokes are data, not lines."""
    for path in (path for folder in OUR_FOLDERS for path in sources(folder)):
        name = str(path.relative_to(ROOT))
        if name in LONG_LINES:
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            bare = re.sub(r'r#+".*|"(?:[^"\\]|\\.)*"|(?:r#*)?"[^"]*$|^\s*<.*>.*$', '""', line)
            if len(line) > WIDTH and (len(bare) > WIDTH or line.lstrip().startswith("//")):
                problems.append(f"{name}:{number}: {len(line)} columns, more than {WIDTH}")


def opponents_stay_in_the_lab() -> None:
    for package in ("foretrace-control", "foretrace-config", "foretraced", "foretrace-sim", "foretrace"):
        # The program has the lab as a feature that is on by default.
        tree = cargo("tree", "-p", package, "-e", "normal", "--no-default-features", "--prefix", "none")
        for banned in re.findall(r"^(rsruckig|foretrace-lab) ", tree, re.MULTILINE):
            problems.append(f"{package} reaches {banned}: what foretrace is compared with belongs to the lab only")


def unsafe_code_is_justified() -> None:
    """SECURITY.md's table names every file with unsafe code, tests included, and how many places it has."""
    listed = {}
    for line in (ROOT / "SECURITY.md").read_text(encoding="utf-8").splitlines():
        row = re.match(r"\| `([^`]+\.rs)` \| (\d+) \| \S", line)
        if row:
            listed[row[1]] = int(row[2])
    found = {}
    for path in (path for folder in OUR_FOLDERS for path in sources(folder)):
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.lstrip().startswith("//")]
        count = sum(len(re.findall(r"\bunsafe\s*(?:\{|\(|fn\b|impl\b|extern\b|trait\b)", line)) for line in lines)
        if count:
            found[str(path.relative_to(ROOT))] = count
    for name in sorted(found.keys() | listed.keys()):
        if found.get(name, 0) != listed.get(name, 0):
            problems.append(f"{name}: {found.get(name, 0)} places with unsafe code, SECURITY.md justifies {listed.get(name, 0)}")


def promised_tests_exist() -> None:
    """Every `file::test` of a document is a test of that file, and there are no fewer than there were."""
    promised = set()
    for doc in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]):
        for name, test in re.findall(r"`([\w./-]+\.rs)::(\w+)`", doc.read_text(encoding="utf-8")):
            promised.add((name, test))
            path = ROOT / name
            if not path.is_file() or not re.search(rf"\bfn {test}\b", path.read_text(encoding="utf-8")):
                problems.append(f"{doc.relative_to(ROOT)} names the test {test}, which {name} does not have")
    if len(promised) < LEAST_PROMISED:
        problems.append(f"documents name {len(promised)} tests, less than {LEAST_PROMISED}: a promise lost its test")


def pictures_say_what_is_said_of_them() -> None:
    """Figures in the text of a link to a picture stand in that picture, and the picture exists."""
    link = re.compile(r"\[([^\]]*)\]\(((?:\.\./|docs/)*pictures/[\w.-]+\.svg)\)")
    for doc in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]):
        name = doc.relative_to(ROOT)
        for text, target in link.findall(doc.read_text(encoding="utf-8")):
            picture = (doc.parent / target).resolve()
            if not picture.is_file():
                problems.append(f"{name} shows {target}, which does not exist")
                continue
            svg = re.sub(r"<style>.*?</style>|<[^>]*>", " ", picture.read_text(encoding="utf-8"), flags=re.DOTALL)
            told = set(re.findall(r"(?<![\d.])\d+(?:\.\d+)?(?![\d.])", svg))
            said = re.findall(r"(?<![\d.\w])\d+(?:\.\d+)?(?=(?:,| and|\s+mm|\s+ms|\s+µs))", text)
            for figure in said:
                if figure not in told:
                    problems.append(f"{name} says {figure} of {target}, which does not: make it anew, or correct the text")


def sizes_and_places() -> None:
    for folder in OUR_FOLDERS:
        for path in sources(folder):
            count = len(path.read_text(encoding="utf-8").splitlines())
            if not path.read_text(encoding="utf-8").startswith("//!"):
                problems.append(f"{path.relative_to(ROOT)}: its first line does not say what it is for (//! ...)")
            if count > MOST_LINES:
                problems.append(f"{path.relative_to(ROOT)}: {count} lines, more than {MOST_LINES}; split it by what it is about")
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    top = {name.split("/")[0] for name in tracked if "/" in name and not name.startswith(".")}
    if top - OUR_FOLDERS - {"docs"}:
        problems.append(f"extra folders at the top level: {sorted(top - OUR_FOLDERS)}")


def main() -> int:
    control_reaches_no_outside_world()
    layers_point_downwards()
    rooms_point_downwards()
    opponents_stay_in_the_lab()
    nowhere_but(r"\biceoryx2\b", "daemon/src", {"daemon/src/ports/shm.rs"}, "only ports/shm.rs names iceoryx2 in the daemon")
    for folder in ("shm-schema/src", "config/src", "daemon", "client"):
        nowhere_but(r"\bunsafe\s*(\{|fn|impl|extern)", folder, UNSAFE_FILES, "unsafe code stands in the listed files only")
    unsafe_code_is_justified()
    nowhere_but(r"\btracing::|\b(info|warn|error|debug|trace)!\(", "daemon/src/rt", set(), "the real-time thread does not log")
    promised_tests_exist()
    pictures_say_what_is_said_of_them()
    sizes_and_places()
    lines_are_short()
    problems.extend([*documents.problems(), *tables.problems(bless=False)])
    for problem in problems:
        print(f"invariant broken: {problem}", file=sys.stderr)
    print(f"invariants: {len(problems)} broken")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
