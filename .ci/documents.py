"""Checks of the documents: width of prose, links and anchors, the book's contents, names of pages and sources, keys of the settings."""

import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
WIDTH = 110
# Two brackets of text may stand in a link's text (a picture, an index), none of its own kind in the target.
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
CODE_THAT_NAMES_PAGES = (".rs", ".toml", ".py", ".service", ".md", ".tsv")


def tracked() -> list[pathlib.Path]:
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [path for name in names if (path := ROOT / name).is_file()]


def prose(text: str) -> list[tuple[int, str]]:
    """Lines outside of code fences, with their numbers."""
    lines, fenced = [], False
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced:
            lines.append((number, line))
    return lines


def too_wide(line: str) -> bool:
    """Longer than WIDTH, no table, no comment, and there is a place to break it: a space outside of code and of a picture's text."""
    if len(line) <= WIDTH or line.lstrip().startswith(("|", "<!--")):
        return False
    whole = re.sub(r"`[^`]*`|!\[[^\]]*\]|^\s*(?:[-*>]|\d+\.)?\s*", lambda found: found[0].replace(" ", "x"), line)
    return " " in whole.rstrip()


def anchors(text: str) -> set[str]:
    """The anchors of the headings, as GitHub and mdBook derive them."""
    found: dict[str, int] = {}
    for _, line in prose(text):
        if heading := re.match(r"#{1,6} (.*)", line):
            plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading[1])
            slug = re.sub(r"[^\w\- ]", "", plain.strip().lower()).replace(" ", "-")
            found[slug] = found.get(slug, 0) + 1
    return {slug if again == 0 else f"{slug}-{again}" for slug, times in found.items() for again in range(times)}


def links(documents: dict[pathlib.Path, str]) -> tuple[list[str], int]:
    problems, count = [], 0
    for path, text in documents.items():
        # Whole paragraphs, because a link's text may wrap. Code between backticks holds no links.
        shown = re.sub(r"`[^`\n]*`", "code", "\n".join(line for _, line in prose(text)))
        for target in LINK.findall(shown):
            if re.match(r"\w+:", target):
                continue
            count += 1
            file, _, anchor = target.partition("#")
            place = (path.parent / file).resolve() if file else path
            if not place.exists():
                problems.append(f"{path.relative_to(ROOT)} links to {target}, which does not exist")
            elif anchor and anchor not in anchors(place.read_text(encoding="utf-8")):
                problems.append(f"{path.relative_to(ROOT)} links to {target}, which is no heading of that page")
    return problems, count


def contents() -> list[str]:
    """Every page of the book stands in its contents once; links are checked as all others are."""
    summary = (ROOT / "docs/SUMMARY.md").read_text(encoding="utf-8")
    listed = [target for target in LINK.findall(summary)]
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")} - {"SUMMARY.md"}
    problems = [f"docs/SUMMARY.md lists {page} {listed.count(page)} times" for page in sorted(pages) if listed.count(page) != 1]
    records = (ROOT / "docs/decisions/README.md").read_text(encoding="utf-8")
    for record in sorted((ROOT / "docs/decisions").glob("0*.md")):
        text = record.read_text(encoding="utf-8")
        missing = [word for word in ("**Context.**", "**Choice", "vidence.**", "**Consequence.**") if word not in text]
        if missing or not re.search(r"^\d{4}-\d\d-\d\d", text, re.MULTILINE):
            problems.append(f"docs/decisions/{record.name} lacks {', '.join(missing) or 'its date'}")
        if f"({record.name})" not in records:
            problems.append(f"docs/decisions/README.md does not list {record.name}")
    return problems


def pages_that_code_names() -> list[str]:
    """A page that code, a comment, a message or a document names by its path exists."""
    problems = []
    for path in tracked():
        if path.suffix not in CODE_THAT_NAMES_PAGES or path == pathlib.Path(__file__):
            continue
        for name in re.findall(r"(?<![\w./-])(?:docs/[\w/-]+\.md|(?:README|ARCHITECTURE|SECURITY|CHANGELOG)\.md)", path.read_text(encoding="utf-8")):
            if not (ROOT / name).is_file() and not (path.parent / name).is_file():
                problems.append(f"{path.relative_to(ROOT)} names {name}, which does not exist")
    return problems


def sources_that_text_names() -> tuple[list[str], int]:
    """A Rust file that a comment or a document names between backticks, by its path or the end of it, exists."""
    paths = tracked()
    sources = [f"/{path.relative_to(ROOT)}" for path in paths if path.suffix == ".rs"]
    problems, count = [], 0
    for path in paths:
        if path.suffix not in (".rs", ".toml", ".md", ".py") or path == pathlib.Path(__file__):
            continue
        lines = path.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines, 1):
            text = line if path.suffix != ".rs" else line.partition("//")[2]
            # A name in capitals stands for the reader's own.
            for name in re.findall(r"`([a-z0-9_./{},-]+\.rs)(?:::?[\w:-]+)?`", text):
                for one in expanded(name):
                    count += 1
                    if not any(source.endswith(f"/{one}") for source in sources):
                        problems.append(f"{path.relative_to(ROOT)}:{number} names {one}, which does not exist")
    return problems, count


def expanded(name: str) -> list[str]:
    """`a/{b,c}.rs` as its two names."""
    braces = re.fullmatch(r"(.*)\{([^}]*)\}(.*)", name)
    return [f"{braces[1]}{part}{braces[3]}" for part in braces[2].split(",")] if braces else [name]


def keys(documents: dict[pathlib.Path, str]) -> tuple[list[str], int]:
    """A key or section of the settings that a page names between backticks stands in the tables of docs/configure/settings.md."""
    known, section = set(), ""
    for line in (ROOT / "docs/configure/settings.md").read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"### `\[([\w.]+)\]`", line):
            section = heading[1]
            known.add(section)
        elif row := re.match(r"\| `(\w+)` \|", line):
            known.add(f"{section}.{row[1]}")
    roots = {name.split(".")[0] for name in known}
    problems, count = [], 0
    for path, text in documents.items():
        for _, line in prose(text):
            for name in re.findall(r"`\[?([a-z][\w]*(?:\.[a-z][\w]*)+)\]?(?: = [^`]*)?`", line):
                if name.split(".")[0] not in roots or name.endswith((".rs", ".md", ".json", ".html")):
                    continue
                count += 1
                if name not in known and not any(key.startswith(f"{name}.") for key in known):
                    problems.append(f"{path.relative_to(ROOT)} names {name}, which is no key of the settings")
    return problems, count


def problems() -> list[str]:
    documents = {path: path.read_text(encoding="utf-8") for path in tracked() if path.suffix == ".md"}
    found = [
        f"{path.relative_to(ROOT)}:{number}: {len(line)} columns of prose, more than {WIDTH}"
        for path, text in documents.items()
        for number, line in prose(text)
        if too_wide(line)
    ]
    wrong_links, link_count = links(documents)
    wrong_keys, key_count = keys(documents)
    wrong_sources, source_count = sources_that_text_names()
    found += wrong_links + contents() + pages_that_code_names() + wrong_sources + wrong_keys
    # A pattern that finds nothing proves nothing.
    if link_count < 150 or key_count < 40 or source_count < 60:
        found.append(f"only {link_count} links, {key_count} keys and {source_count} sources were found in the documents")
    return found
