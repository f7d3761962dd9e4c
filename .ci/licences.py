"""Checks licence and source of every dependency, and its single version where deny.toml wants one: of the workspace, and of
the Python package, which is a workspace of its own. From `cargo metadata`, which fetches what was not fetched before.

A licence expression passes if one of its alternatives does. Advisories need a database: see .ci/run.
"""

import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
WORKSPACES = ("", "client/python")


def main() -> int:
    rules = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))
    return 1 if sum(problems(folder, rules) for folder in WORKSPACES) else 0


def problems(folder: str, rules: dict) -> int:
    allowed = set(rules["licenses"]["allow"])
    command = ["cargo", "metadata", "--locked", "--format-version", "1"]
    told = subprocess.run(command, cwd=ROOT / folder, capture_output=True, text=True)
    if told.returncode != 0:
        print(f"licences: {folder or 'the workspace'}: `{' '.join(command)}` failed:\n{told.stderr.rstrip()}", file=sys.stderr)
        return 1
    packages = json.loads(told.stdout)["packages"]
    bad = 0
    for package in packages:
        name = f"{package['name']} {package['version']}"
        expression = (package["license"] or "").replace("(", "").replace(")", "")
        alternatives = re.split(r"\s+OR\s+|/", expression)
        if not any(all(part.strip() in allowed for part in re.split(r"\s+AND\s+", a)) for a in alternatives):
            print(f"licence: {name} is under '{expression}', which deny.toml does not allow", file=sys.stderr)
            bad += 1
        if package["source"] is not None and not package["source"].startswith("registry+"):
            print(f"source: {name} comes from {package['source']}, not from the registry", file=sys.stderr)
            bad += 1
    for single in (ban["name"] for ban in rules["bans"]["deny"] if ban.get("deny-multiple-versions")):
        versions = sorted(package["version"] for package in packages if package["name"] == single)
        if len(versions) != 1:
            print(f"versions: {single} {versions}, deny.toml wants exactly one", file=sys.stderr)
            bad += 1
    print(f"licences: {folder or 'the workspace'}: {len(packages)} packages, {bad} problems")
    return bad


if __name__ == "__main__":
    sys.exit(main())
