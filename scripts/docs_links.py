#!/usr/bin/env python3
"""Checks that the documentation is complete, puts a book's sources together, and checks the links of the built book.

Standard library only. Links between the sources are a test of the command (retina-cli/tests/command/docs.rs).

    docs_links.py check        SUMMARY.md names each page, a reference has every key that the code reads, a picture has
                               words and a page that shows it
    docs_links.py stage DIR    docs/ and the pages of the root that it links to, as mdBook takes them
    docs_links.py built DIR    the book's pages: links, anchors, pictures, and nothing from another host

Exit code 1: something is missing or leads nowhere.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
# Pages beside docs/ that belong to the book.
BESIDE = ["README.md", "ARCHITECTURE.md", "STYLE.md", "VALIDATION.md", "validation/README.md"]
# References, and the sources whose keys they have to name; of a source with other structs, which one.
KEYS = {
    "setup.md": ["retina-geometry/src/setup.rs", "retina-geometry/src/bench_setup.rs", "retina-geometry/src/limits.rs"],
    "scene.md": ["retina-scene/src/file.rs"],
    "scenarios.md": [
        "retina-experiments/src/far_range/scenario.rs",
        "retina-experiments/src/full_disk/scenario.rs",
        "retina-experiments/src/full_disk/filter.rs",
        "retina-experiments/src/flashes/scenario.rs",
        "retina-experiments/src/experiment.rs",
        "retina-navigation/src/flashes/detect.rs FlashOptions",
        "retina-navigation/src/synthetic/points.rs",
    ],
}
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")


def outside_code(text: str) -> str:
    """Markdown with code blanked out, line by line, so that places stay."""
    out, inside = [], False
    for line in text.splitlines():
        if line.lstrip().startswith("```"):
            inside = not inside
            out.append("")
        else:
            out.append("" if inside else re.sub(r"`[^`]*`", lambda code: " " * len(code.group()), line))
    return "\n".join(out)


def pages() -> list[Path]:
    """The pages that are checked."""
    return [ROOT / name for name in BESIDE] + sorted(DOCS.glob("*.md"))


def keys(source: str) -> set[str]:
    """The fields of a Rust file's structs that are read from files: of all, or of the one that is named."""
    file, _, only = source.partition(" ")
    text = (ROOT / file).read_text(encoding="utf-8")
    found = set()
    struct = re.compile(
        r"#\[derive\(([^)]*)\)\]\s*(?:#\[[^\n]*\]\s*)*(?:pub(?:\(crate\))? )?struct (\w+) \{(.*?)\n\}", re.DOTALL
    )
    for derived, name, body in struct.findall(text):
        if "Deserialize" in derived and only in ("", name):
            skipped = set(re.findall(r"#\[serde\(skip\)\]\s*(?:pub(?:\(crate\))? )?(\w+):", body))
            found |= set(re.findall(r"^\s+(?:pub(?:\(crate\))? )?([a-z]\w*):", body, re.MULTILINE)) - skipped
    return found


def unnamed_keys() -> list[str]:
    """Keys that the code reads and a reference does not name."""
    wrong = []
    for page, sources in KEYS.items():
        code = " ".join(re.findall(r"`([^`]*)`", (DOCS / page).read_text(encoding="utf-8")))
        tables = " ".join(re.findall(r"`\[+([^\]`]*)\]", (DOCS / page).read_text(encoding="utf-8")))
        words = set(re.findall(r"\w+", f"{code} {tables}"))
        read: set[str] = set()
        for source in sources:
            read |= keys(source)
        if len(read) < 10:
            wrong.append(f"docs/{page}: only {len(read)} keys were found in {', '.join(sources)}")
        wrong += [f"docs/{page}: the key `{key}` is missing" for key in sorted(read - words)]
    return wrong


def check() -> list[str]:
    """What is missing in the sources."""
    wrong, texts = [], {page: page.read_text(encoding="utf-8") for page in pages()}
    for page, text in texts.items():
        for number, line in enumerate(outside_code(text).splitlines(), 1):
            for mark, words, link in LINK.findall(line):
                if mark and not words.strip():
                    place = f"{page.relative_to(ROOT)}:{number}: {link}"
                    wrong.append(f"{place}: a picture without words for those who do not see it")
    summary = texts.get(DOCS / "SUMMARY.md", "")
    listed = {link for _, _, link in LINK.findall(summary)}
    unlisted = {page.name for page in DOCS.glob("*.md")} - listed - {"SUMMARY.md"}
    wrong += [f"docs/SUMMARY.md: {name} is missing" for name in sorted(unlisted)]
    wrong += unnamed_keys()
    shown = "".join(texts.values())
    figures = sorted(figure.name for figure in (DOCS / "figures").iterdir())
    wrong += [f"docs/figures/{name}: no page shows it" for name in figures if f"figures/{name}" not in shown]
    return wrong


def staged(name: str) -> str:
    """Where a page beside docs/ stands in the book."""
    return "project-" + name.replace("/", "-").lower()


def stage(folder: Path) -> list[str]:
    """Copies the sources into a folder, and turns links so that they hold there."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(DOCS, folder)
    places = {ROOT / name: folder / staged(name) for name in BESIDE}
    places |= {page: folder / page.name for page in DOCS.glob("*.md")}
    for page, place in places.items():
        text = page.read_text(encoding="utf-8")

        def turned(match: re.Match[str]) -> str:
            mark, words, link = match.groups()
            parts = urlsplit(link)
            if parts.scheme or not parts.path:
                return match.group()
            target = (page.parent / unquote(parts.path)).resolve()
            if target in places:
                link = places[target].name
            elif target.is_relative_to(DOCS):
                link = os.path.relpath(target, DOCS)
            else:
                # A file of the project that is no page: its name remains, without a link.
                return words
            return f"{mark}[{words}]({link}{'#' + parts.fragment if parts.fragment else ''})"

        place.write_text(LINK.sub(turned, text), encoding="utf-8")
    return []


class Page(HTMLParser):
    """The names, links and loaded files of a built page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self.names |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and "href" in given:
            self.loaded.append(given["href"])
        elif "src" in given:
            self.loaded.append(given["src"])


def built(folder: Path) -> list[str]:
    """What leads nowhere in a built book."""
    wrong = []
    parsed = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    for path, page in parsed.items():
        if path.name in ("404.html", "print.html", "toc.html"):
            continue
        for link in page.links + page.loaded:
            parts = urlsplit(link)
            place = f"{path.relative_to(folder.resolve())}: {link}"
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    wrong.append(f"{place}: is fetched from another host")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                wrong.append(f"{place}: is not there")
            elif parts.fragment and target in parsed and unquote(parts.fragment) not in parsed[target].names:
                wrong.append(f"{place}: has no such place")
    if len(parsed) < 10:
        wrong.append(f"{folder}: only {len(parsed)} pages were built")
    return wrong


def main() -> int:
    match sys.argv[1:]:
        case ["check"]:
            wrong = check()
        case ["stage", folder]:
            wrong = stage(Path(folder))
        case ["built", folder]:
            wrong = built(Path(folder))
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    for line in wrong:
        print(f"docs-site: {line}", file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
