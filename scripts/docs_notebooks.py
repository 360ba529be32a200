#!/usr/bin/env python3
"""Executes the notebooks of docs/notebooks from top to bottom, and refuses one that keeps outputs.

Runs in an environment with the package `retina` and validation/requirements-notebooks.txt. Exit code 1: a cell failed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

ROOT = Path(__file__).resolve().parent.parent
# A notebook takes some ten seconds; a machine that is busy, several times as long.
TIMEOUT_S = 300


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--work", type=Path, required=True, help="folder in which they run; made anew")
    parser.add_argument("notebooks", type=Path, nargs="*", default=sorted((ROOT / "docs/notebooks").glob("*.ipynb")))
    arguments = parser.parse_args()
    shutil.rmtree(arguments.work, ignore_errors=True)
    arguments.work.mkdir(parents=True)
    (arguments.work / "assets").symlink_to(ROOT / "assets")
    failed = False
    for path in arguments.notebooks:
        begin = time.monotonic()
        notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
        nbformat.validate(notebook)
        if any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells):
            print(f"docs-site: {path.name}: keeps outputs; clear them before you commit it", file=sys.stderr)
            failed = True
        client = NotebookClient(
            notebook,
            timeout=TIMEOUT_S,
            extra_arguments=["--log-level=ERROR"],
            resources={"metadata": {"path": str(arguments.work)}},
        )
        try:
            client.execute()
        except CellExecutionError as error:
            print(f"docs-site: {path.name}: {error}", file=sys.stderr)
            failed = True
        nbformat.write(notebook, arguments.work / path.name)  # type: ignore[no-untyped-call]
        print(f"docs/notebooks/{path.name}: {len(notebook.cells)} cells, {time.monotonic() - begin:.0f} s", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
