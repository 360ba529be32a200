#!/usr/bin/env python3
"""Runs the commands that pages of docs/ show, compares what they print with the page, and makes the pages' pictures.

In a page

    ```sh       is run, block after block, by bash in one folder a page, in which `assets` is the project's
    ```text     after it is what the commands print: its lines must come out in this order. `...` stands for anything;
                numbers may differ by a tenth, or by two in their last digit
    <!-- picture: figures/NAME from SOURCE [crop=X,Y,W,H] [width=W] [white=DN] [svg=N] -->
                makes docs/figures/NAME of a file that the commands wrote. svg=N takes the Nth drawing of a report page,
                white=N shows that count, or digital number of a camera (default: the brightest), as white

Exit code 1: a command failed, a page shows what did not come out, or a picture is not what the commands make.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w]*\.(?:png|csv|toml))")
PICTURE = re.compile(r"<!-- picture: (\S+) from (\S+)((?: \w+=\S+)*) -->")
# Grey levels (rms, of 255) by which a picture may differ from the one in docs/figures: noise of another processor.
MOST_DIFFERENCE = 6.0
MOST_PNG_BYTES = 150_000


@dataclass
class Block:
    """Commands, with the lines that they shall print."""

    line: int
    commands: str
    prints: list[str] = field(default_factory=list)


@dataclass
class Picture:
    """A picture of a page."""

    name: str
    source: str
    options: dict[str, str]


class Wrong(Exception):
    """A page and what came out do not agree."""


def parse(text: str) -> tuple[list[Block], list[Picture]]:
    """The blocks that are run and the pictures of a page."""
    blocks: list[Block] = []
    language, begin, lines = None, 0, []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("```"):
            lines.append(line)
        elif language is None:
            language, begin, lines = line[3:].strip(), number + 1, []
        else:
            if language == "sh":
                blocks.append(Block(begin, "\n".join(lines)))
            elif language == "text" and blocks:
                blocks[-1].prints += lines
            language = None
    pictures = [
        Picture(name, source, dict(option.split("=", 1) for option in options.split()))
        for name, source, options in PICTURE.findall(text)
    ]
    return blocks, pictures


def agrees(expected: str, found: str) -> bool:
    """Whether a line of a page is a line that was printed."""
    pattern, numbers, at = "", [], 0
    for match in NUMBER.finditer(expected):
        pattern += literal(expected[at : match.start()]) + f"({NUMBER.pattern})"
        numbers.append(match.group())
        at = match.end()
    matched = re.fullmatch(pattern + literal(expected[at:]), found.strip())
    return matched is not None and all(close(*pair) for pair in zip(numbers, matched.groups()))


def literal(text: str) -> str:
    """A pattern of text in which `...` is anything and white space is white space."""
    parts = [r"\s+".join(re.escape(word) for word in re.split(r"\s+", part)) for part in text.split("...")]
    return ".*?".join(parts)


def close(shown: str, found: str) -> bool:
    """Whether two numbers are the same but for rounding and processors."""
    digits = re.fullmatch(r"[-+]?\d+(?:\.(\d+))?(?:e([-+]?\d+))?", shown)
    last = 10.0 ** (int(digits.group(2) or 0) - len(digits.group(1) or "")) if digits else 0.0
    return abs(float(shown) - float(found)) <= max(0.1 * abs(float(shown)), 2.0 * last)


def compare(block: Block, printed: str) -> None:
    """Refuses a block whose lines did not come out in their order."""
    rest = printed.splitlines()
    for line in (line.strip() for line in block.prints):
        if line in ("", "..."):
            continue
        at = next((number for number, found in enumerate(rest) if agrees(line, found)), None)
        if at is None:
            came = "\n".join(rest)
            raise Wrong(f"this line of the page did not come out:\n  {line}\nwhat came out from there on:\n{came}")
        rest = rest[at + 1 :]


def run(page: Path, folder: Path, show: bool) -> list[Picture]:
    """Runs a page's commands in a folder; `show` prints what they print and compares nothing."""
    blocks, pictures = parse(page.read_text(encoding="utf-8"))
    folder.mkdir(parents=True)
    (folder / "assets").symlink_to(ROOT / "assets")
    begin = time.monotonic()
    for block in blocks:
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block.commands],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        where = f"{page.relative_to(ROOT)}:{block.line}"
        if done.returncode != 0:
            raise Wrong(f"{where}: exit code {done.returncode}\n{block.commands}\n{done.stdout}")
        if show:
            print(f"--- {where}\n{done.stdout}", flush=True)
            continue
        try:
            compare(block, done.stdout)
        except Wrong as wrong:
            raise Wrong(f"{where}: {wrong}") from None
    print(f"{page.relative_to(ROOT)}: {len(blocks)} blocks run, {time.monotonic() - begin:.0f} s", flush=True)
    return pictures


def make(picture: Picture, folder: Path, made: Path) -> Path:
    """Makes a picture from what the commands wrote."""
    source, target = folder / picture.source, made / picture.name
    target.parent.mkdir(parents=True, exist_ok=True)
    if not source.is_file():
        raise Wrong(f"{picture.name}: the commands wrote no {picture.source}")
    if "svg" in picture.options:
        drawings = re.findall(r"<svg.*?</svg>", source.read_text(encoding="utf-8"), re.DOTALL)
        target.write_text(drawings[int(picture.options["svg"])] + "\n", encoding="utf-8")
    elif source.suffix == ".svg":
        shutil.copyfile(source, target)
    else:
        make_png(picture, source, target)
    return target


def make_png(picture: Picture, source: Path, target: Path) -> None:
    """Cuts and resizes an image; the digital numbers of a camera (16 bits) become grey levels."""
    from PIL import Image

    image: Image.Image = Image.open(source)
    if image.mode.startswith("I"):
        image = image.convert("I")
        white = float(picture.options.get("white") or str(image.getextrema()[1]))
        image = image.point(lambda value: value * (255.0 / white)).convert("L")
    elif "white" in picture.options:
        dimmer = 255.0 / float(picture.options["white"])
        image = image.convert("L").point(lambda value: min(255, round(value * dimmer)))
    image = image.convert("L" if image.mode == "L" or is_grey(image) else "RGB")
    if crop := picture.options.get("crop"):
        x, y, width, height = map(int, crop.split(","))
        image = image.crop((x, y, x + width, y + height))
    if wanted := picture.options.get("width"):
        width = int(wanted)
        # Enlarged pixels are to be seen as pixels.
        how = Image.Resampling.NEAREST if width > image.width else Image.Resampling.LANCZOS
        image = image.resize((width, round(image.height * width / image.width)), how)
    image.save(target, optimize=True)


def is_grey(image: object) -> bool:
    """Whether an image has equal channels."""
    from PIL import ImageChops

    bands = image.convert("RGB").split()  # type: ignore[attr-defined]
    return all(ImageChops.difference(bands[0], band).getbbox() is None for band in bands[1:])


def same(made: Path, kept: Path) -> bool:
    """Whether a picture looks as the kept one does."""
    if not kept.is_file():
        return False
    if made.suffix == ".svg":
        # The words of a drawing; places and figures may differ in their last digits.
        words = [re.findall(r">([^<>]*[A-Za-z][^<>]*)<", path.read_text(encoding="utf-8")) for path in (made, kept)]
        stripped = [[NUMBER.sub("", word) for word in text] for text in words]
        return stripped[0] == stripped[1]
    from PIL import Image, ImageChops, ImageStat

    with Image.open(made) as one, Image.open(kept) as other:
        if one.size != other.size or one.mode != other.mode:
            return False
        difference = ImageStat.Stat(ImageChops.difference(one, other).convert("L"))
        return difference.rms[0] <= MOST_DIFFERENCE


def checked(page: Path, work: Path, show: bool, write: bool) -> str:
    """Runs a page and makes its pictures; what is wrong with them, or nothing."""
    try:
        for picture in run(page, work / page.stem, show):
            made = make(picture, work / page.stem, work / "made")
            kept = ROOT / "docs" / picture.name
            if made.suffix == ".png" and made.stat().st_size > MOST_PNG_BYTES:
                raise Wrong(f"{picture.name}: {made.stat().st_size} bytes, more than {MOST_PNG_BYTES}")
            if write:
                shutil.copyfile(made, kept)
            elif not same(made, kept):
                raise Wrong(f"{picture.name} is not what the commands make: look at it, then scripts/docs-site --write")
    except Wrong as wrong:
        return str(wrong)
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--work", type=Path, required=True, help="folder for what the commands write; made anew")
    parser.add_argument("--show", action="store_true", help="print what the commands print; compare nothing")
    parser.add_argument("--write", action="store_true", help="put the pictures into docs/figures")
    parser.add_argument("pages", type=Path, nargs="+")
    arguments = parser.parse_args()
    work = arguments.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    pages = [page.resolve() for page in arguments.pages]
    # A command leaves a core idle now and then; a second page uses it.
    with ThreadPoolExecutor(max_workers=2) as pool:
        wrong = list(pool.map(lambda page: checked(page, work, arguments.show, arguments.write), pages))
    for page, text in zip(pages, wrong):
        if text:
            print(f"docs-site: {page.name}: {text}", file=sys.stderr)
    return int(any(wrong))


if __name__ == "__main__":
    sys.exit(main())
