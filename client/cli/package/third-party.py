#!/usr/bin/env python3
"""Writes the licences of everything that is linked into the program and the library: client/cli/package/third-party.py FILE.

From `cargo metadata`, which fetches what was not fetched before: every crate that is built for this machine, with the texts
that it brings, each text once.
Fails where a crate brings no text and its licence is none of those that other crates bring. Without FILE it only checks.
"""

import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
# What is shipped: the program, and the library for C.
SHIPPED = {"foretrace", "foretrace-c"}
TEXTS = re.compile(r"^(licen[cs]e|copying|copyright|notice|unlicense|authors)", re.IGNORECASE)
# A text that tells a licence by a sentence of it.
TELLTALE = {
    "MIT": "Permission is hereby granted, free of charge",
    "Apache-2.0": "Apache License",
    "BSD-3-Clause": "Redistribution and use in source and binary forms",
    "BSD-2-Clause": "Redistribution and use in source and binary forms",
    "ISC": "Permission to use, copy, modify, and/or distribute this software",
    "Zlib": "This software is provided 'as-is'",
    "Unlicense": "This is free and unencumbered software",
    "Unicode-3.0": "UNICODE LICENSE V3",
    "CC0-1.0": "CC0",
    "BSL-1.0": "Boost Software License",
}
THREE = """Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in
all copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN
THE SOFTWARE."""


def output(*command: str) -> str:
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if told.returncode != 0:
        raise SystemExit(f"third-party: `{' '.join(command)}` failed in {ROOT}:\n{told.stderr.rstrip()}")
    return told.stdout


def linked() -> list[dict]:
    """The crates of others below what is shipped; neither those for building nor those for tests."""
    machine = re.search(r"^host: (\S+)", output("rustc", "-vV"), re.MULTILINE)[1]
    told = json.loads(output("cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", machine))
    packages = {package["id"]: package for package in told["packages"]}
    nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
    waiting = [id for id, package in packages.items() if package["name"] in SHIPPED and package["source"] is None]
    if len(waiting) != len(SHIPPED):
        raise SystemExit(f"third-party: {sorted(SHIPPED)} are not all in the workspace")
    seen = set(waiting)
    while waiting:
        for dependency in nodes[waiting.pop()]["deps"]:
            id = dependency["pkg"]
            normal = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            # What such a crate writes is in the program; the crate and what it needs is not.
            macro = any("proc-macro" in target["kind"] for target in packages[id]["targets"])
            if normal and not macro and id not in seen:
                seen.add(id)
                waiting.append(id)
    others = [packages[id] for id in seen if packages[id]["source"] is not None]
    return sorted(others, key=lambda package: (package["name"], package["version"]))


def texts(package: dict) -> list[str]:
    """The licences and notices in the folder of a crate."""
    folder = pathlib.Path(package["manifest_path"]).parent
    files = sorted(file for file in folder.iterdir() if file.is_file() and TEXTS.match(file.name))
    if package["license_file"] and (named := folder / package["license_file"]).is_file() and named not in files:
        files.append(named)
    for below in ("LICENSES", "licenses"):
        files += sorted(file for file in (folder / below).glob("*") if file.is_file())
    return [file.read_text(encoding="utf-8", errors="replace").strip() for file in files if file.suffix not in {".rs", ".html"}]


def document() -> tuple[str, int]:
    crates = linked()
    places: dict[str, int] = {}
    lines = ["Licences of what is linked into foretrace and its library for C", ""]
    bare: list[tuple[str, str]] = []
    for package in crates:
        name, licence = f"{package['name']} {package['version']}", package["license"] or "see its text"
        own = texts(package)
        numbers = [places.setdefault(text, len(places) + 1) for text in own]
        if not own:
            bare.append((name, licence))
        where = ", ".join(f"text {number}" for number in numbers) or "no text of its own; the licence is below"
        people = "; ".join(re.sub(r"\s*<[^>]*>", "", person) for person in package["authors"])
        lines += [f"{name}: {licence} ({where})"] + ([f"    {people}"] if people else []) + ([f"    {package['repository']}"] if package["repository"] else [])
    everything = "\n".join(places)
    wrong = []
    for name, licence in bare:
        alternatives = [word.strip(" ()") for word in re.split(r"\s+OR\s+|/", licence)]
        if not any(TELLTALE.get(word, "\0") in everything for word in alternatives):
            wrong.append(f"{name} is under {licence!r} and brings no text, nor does another crate")
    if wrong or len(crates) < 100:
        raise SystemExit("third-party: " + ("\n".join(wrong) or f"only {len(crates)} crates"))
    lock = json.loads((ROOT / "client/console/bundle/package-lock.json").read_text(encoding="utf-8"))
    three = lock["packages"][""]["dependencies"]["three"]
    lines += ["", f"three.js {three}, in the console's page: MIT", "", "The MIT License", "", "Copyright © 2010-2026 three.js authors", "", THREE]
    lines += ["", "The standard library of Rust: MIT OR Apache-2.0", "    The Rust Project Developers", "    https://github.com/rust-lang/rust"]
    for text, number in places.items():
        lines += ["", "=" * 78, f"text {number}", "=" * 78, "", text]
    return "\n".join(line.rstrip() for line in "\n".join(lines).splitlines()) + "\n", len(crates)


def main() -> int:
    text, count = document()
    for file in sys.argv[1:2]:
        pathlib.Path(file).write_text(text, encoding="utf-8")
    print(f"third-party: {count} crates, {len(text.encode())} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
