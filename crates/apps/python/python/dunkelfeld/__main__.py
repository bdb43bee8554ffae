"""The command line: `dunkelfeld`, or `python -m dunkelfeld`."""

import signal
import sys

from . import _native


def main() -> int:
    """Runs the command line of the process, and gives its exit code."""
    # The program itself ends a render at an interrupt, and keeps its best image.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.run_command(["dunkelfeld", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
