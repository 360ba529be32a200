"""The command ``retina``, as the wheel installs it."""

from __future__ import annotations

import signal
import sys

from . import _native


def main() -> int:
    """Run the command with the process' arguments.

    Returns
    -------
    int
        The exit code: 0 done; 1 done, and a tolerance that was asked for is exceeded; 2 bad input or failure.
    """
    # Python's own handler only notes an interrupt until Python code runs again, and the command is no Python code.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.run_command(["retina", *sys.argv[1:]])
