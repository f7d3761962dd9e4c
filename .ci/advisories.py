"""Checks Cargo.lock, and that of the Python package, against the advisories noted in .ci/advisories.toml, without network.

Fails on a version that an advisory affects and nobody has accepted, on an acceptance that deny.toml does not repeat or that is no
longer needed, and on a package that the two have in different versions. Says how many packages nobody has looked up.
"""

import pathlib
import re
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent


def version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.split(r"[-+]", text)[0].split("."))


def different(lock: dict, other: dict) -> list[str]:
    """Packages of `other` that `lock` has too, but not in that version: the Python package is the same law only without any."""
    known: dict[str, set[str]] = {}
    for entry in lock["package"]:
        known.setdefault(entry["name"], set()).add(entry["version"])
    return [
        f"{entry['name']} {entry['version']} of the Python package is {', '.join(sorted(known[entry['name']]))} in Cargo.lock: "
        "take that version (cargo update --precise)"
        for entry in other["package"]
        if entry["name"] in known and entry["version"] not in known[entry["name"]]
    ]


def problems(locked: list[dict], notes: dict, ignored: set[str]) -> list[str]:
    found = []
    for name, advisory in notes["advisories"].items():
        package, safe_from = advisory["package"], advisory["safe_from"]
        versions = sorted({entry["version"] for entry in locked if entry["name"] == package})
        affected = [text for text in versions if version(text) < version(safe_from)]
        accepted = "accepted" in advisory
        if affected and not accepted:
            found.append(f"{package} {', '.join(affected)}: {name}, safe from {safe_from}")
        if accepted and not affected:
            found.append(f"{package}: {name} is accepted, but no version in Cargo.lock is affected; remove the acceptance")
        if accepted != (name in ignored):
            found.append(f"{name}: .ci/advisories.toml and [advisories] ignore of deny.toml disagree on whether it is accepted")
    return found


def main() -> int:
    read = lambda path: tomllib.loads((ROOT / path).read_text(encoding="utf-8"))
    lock, other, notes = read("Cargo.lock"), read("client/python/Cargo.lock"), read(".ci/advisories.toml")
    locked = lock["package"] + other["package"]
    ignored = {entry["id"] for entry in read("deny.toml")["advisories"].get("ignore", [])}
    found = problems(locked, notes, ignored) + different(lock, other)
    for problem in found:
        print(f"advisory: {problem}", file=sys.stderr)
    known = set(notes["nothing_known"].split()) | {advisory["package"] for advisory in notes["advisories"].values()}
    # The middleware is one repository under many names; Windows is no target.
    others = {entry["name"] for entry in locked if "source" in entry and not entry["name"].startswith(("iceoryx2-", "windows"))}
    print(f"advisories: {len(notes['advisories'])} noted on {notes['looked_up_on']}, {len(found)} problems; {len(others - known)} of {len(others)} packages not looked up")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
