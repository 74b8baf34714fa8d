"""The program, as `python -m cobscope` and as the command `cobscope`."""

import os
import signal
import sys

from ._cobscope import run


def main():
    """Runs the program with the arguments of the process; returns its exit status."""
    # Python's handler only sets a flag, so that Ctrl-C would not end the program.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return run([os.path.abspath(sys.argv[0]), *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
