"""Keeps the words of the code plain: type names that mean one thing, doc comments that say something, titles that agree.

Exits non-zero with file and line. Where a bound is not reached yet, the figure of today is the bound: it may fall, never rise.
"""

import collections
import pathlib
import re
import subprocess
import sys

import size

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Share of type names that are in use for several things [%].
MOST_HOMONYMS = 1.0
# Doc comments of fewer than four words, but for error variants, units and ranges; the aim is none.
MOST_EMPTY_DOCS = 220
problems: list[str] = []


def sources() -> dict[str, str]:
    names = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.rs"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    found = {}
    for name in names:
        below = re.sub(r"^(daemon/control|daemon|config|shm-schema|client/[a-z-]+|client)/", "", name)
        if not name.startswith("tests/") and size.is_product(below) and (ROOT / name).exists():
            found[name] = size.without_tests((ROOT / name).read_text(encoding="utf-8"))
    return found


def homonyms(files: dict[str, str]) -> None:
    """Names of types that are declared more than once."""
    places = collections.defaultdict(list)
    for name, text in files.items():
        for found in re.finditer(r"^[ \t]*(?:pub(?:\([^)]*\))? )?(?:struct|enum|trait|type|union) (\w+)", text, re.MULTILINE):
            if not re.match(r"[ \t]", found[0]):
                places[found[1]].append(name)
    several = {name: where for name, where in places.items() if len(where) > 1}
    share = 100.0 * len(several) / len(places)
    print(f"words: {len(several)} of {len(places)} type names mean several things, {share:.1f} % (at most {MOST_HOMONYMS})")
    if share > MOST_HOMONYMS:
        worst = sorted(several, key=lambda name: -len(several[name]))[:20]
        problems.append("type names that mean several things: " + ", ".join(f"{name} ({len(several[name])})" for name in worst))


def docs(files: dict[str, str]) -> None:
    empty, open_ended = [], []
    for name, text in files.items():
        lines = text.split("\n")
        for at, line in enumerate(lines):
            doc = re.match(r"\s*/// ?(.*)", line)
            follows = re.match(r"\s*///", lines[at + 1]) if at + 1 < len(lines) else None
            if not doc or follows:
                continue
            single = at == 0 or not re.match(r"\s*///", lines[at - 1])
            item = next((one.strip() for one in lines[at + 1 :] if not one.strip().startswith("#")), "")
            is_error = any(one.strip().startswith("#[error") for one in lines[at + 1 : at + 3])
            says_unit = re.search(r"\[|\d|`", doc[1])
            if single and len(doc[1].split()) < 4 and not is_error and not says_unit and item:
                empty.append(f"{name}:{at + 1}")
            if doc[1].rstrip().endswith((",", ";", ":")) and not item.startswith(("|", "//")):
                open_ended.append(f"{name}:{at + 1}: the doc comment ends in {doc[1].rstrip()[-1]!r}")
    print(f"words: {len(empty)} doc comments of fewer than four words (at most {MOST_EMPTY_DOCS})")
    if len(empty) > MOST_EMPTY_DOCS:
        problems.append(f"{len(empty)} doc comments of fewer than four words, for example {', '.join(empty[-5:])}")
    problems.extend(open_ended)


def literals(files: dict[str, str]) -> None:
    """No literal is broken behind a word of one or two letters in the middle of a line: a rewrap did that, no writer."""
    for name, text in files.items():
        for at, line in enumerate(text.split("\n"), 1):
            if re.search(r"(?:^|[\s(])[A-Za-z]{1,2} \\$", line) and len(line) < 90:
                problems.append(f"{name}:{at}: a text is broken behind a short word in the middle of the line")


def titles() -> None:
    """Titles of the book are those of its pages."""
    summary = ROOT / "docs/SUMMARY.md"
    for at, line in enumerate(summary.read_text(encoding="utf-8").splitlines(), 1):
        found = re.match(r"\s*[-*] \[(.+)\]\((.+\.md)\)", line)
        if not found:
            continue
        page = (summary.parent / found[2]).read_text(encoding="utf-8")
        title = next((one[2:].strip() for one in page.splitlines() if one.startswith("# ")), "")
        if found[1] not in (title, title.split(":")[0]):
            problems.append(f"docs/SUMMARY.md:{at}: '{found[1]}', but the page is titled '{title}'")


def main() -> int:
    files = sources()
    homonyms(files)
    docs(files)
    literals(files)
    titles()
    for problem in problems:
        print(f"words: {problem}", file=sys.stderr)
    print(f"words: {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
