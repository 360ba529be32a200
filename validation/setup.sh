#!/usr/bin/env bash
# Makes the Python environment of the validation programs in validation/.venv, and says how to get Blender.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
python="${PYTHON:-python3}"
"$python" -m venv .venv
.venv/bin/pip install --quiet --disable-pip-version-check -r requirements.txt
printf 'validation: the environment is ready, validation/.venv/bin/python\n' >&2
if ! command -v blender >/dev/null; then
    printf 'validation: bench_cycles.py needs Blender: apt-get install --no-install-recommends blender python3-numpy\n' >&2
fi
