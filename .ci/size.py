"""Lines of product code per crate: without tests, comments, blank lines and the vendored bundle.

`.ci/size.py [COMMIT]` counts this tree, and beside it a commit of this repository. Rust and the console's page count.
"""

import collections
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENDORED = {"three.bundle.js"}
KINDS = {".rs", ".js", ".css", ".html", ".script"}


def is_product(name: str) -> bool:
    path = pathlib.PurePosixPath(name)
    folders = set(path.parts[:-1])
    if path.suffix not in KINDS or path.name in VENDORED or folders & {"tests", "examples", "bundle"} or name.startswith("fixtures/"):
        return False
    return path.stem != "tests" and not path.stem.endswith("_tests")


def without_tests(text: str) -> str:
    """Items under `#[cfg(test)]` go, up to the line that closes them at their own depth."""
    kept, rest = [], iter(text.split("\n"))
    for line in rest:
        if line.strip() != "#[cfg(test)]":
            kept.append(line)
            continue
        depth = line[: len(line) - len(line.lstrip())]
        item = next((line for line in rest if not line.startswith(depth + "#[")), "")
        if item.rstrip().endswith((";", ",", "}")):
            continue
        for line in rest:
            if line.rstrip() in (depth + "}", depth + "};", depth + "},", depth + ");", depth + "];"):
                break
    return "\n".join(kept)


def lines(text: str, suffix: str) -> int:
    if suffix == ".rs":
        text = without_tests(text)
    text = re.sub(r"/\*.*?\*/|<!--.*?-->", "", text, flags=re.DOTALL)
    comment = "#" if suffix == ".script" else "//"
    return sum(1 for line in text.split("\n") if line.strip() and not line.strip().startswith(comment))


def count(files: dict[str, str]) -> collections.Counter:
    crates = sorted((str(pathlib.PurePosixPath(name).parent) for name in files if name.endswith("Cargo.toml")), key=len, reverse=True)
    names = {crate: tomllib.loads(files[f"{crate}/Cargo.toml"])["package"]["name"] for crate in crates if crate != "."}
    sizes = collections.Counter()
    for name, text in files.items():
        crate = next((crate for crate in crates if crate != "." and name.startswith(crate + "/")), None)
        if crate and names[crate] not in ("foretrace-tests", "foretrace-loom") and is_product(name[len(crate) + 1 :]):
            sizes[names[crate]] += lines(text, pathlib.PurePosixPath(name).suffix)
    return sizes


def git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def wanted(name: str) -> bool:
    return name.endswith("Cargo.toml") or pathlib.PurePosixPath(name).suffix in KINDS


def at(commit: str) -> dict[str, str]:
    return {name: git("show", f"{commit}:{name}") for name in git("ls-tree", "-r", "--name-only", commit).splitlines() if wanted(name)}


def here() -> dict[str, str]:
    names = git("ls-files", "--cached", "--others", "--exclude-standard").splitlines()
    return {name: (ROOT / name).read_text(encoding="utf-8") for name in names if wanted(name) and (ROOT / name).exists()}


def main() -> int:
    now = count(here())
    before = count(at(sys.argv[1])) if len(sys.argv) > 1 else None
    for name in sorted(set(now) | set(before or ())):
        print(f"{name:22} {now[name]:6}" + (f" {before[name]:6}" if before else ""))
    total = sum(now.values())
    print(f"{'all':22} {total:6}" + (f" {sum(before.values()):6}  {total / sum(before.values()):.3f}" if before else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
