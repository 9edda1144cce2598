"""`python -m heronry_tools` is the program `heronry`.

Ctrl-C and SIGTERM are handled from the start, before the slow imports of the command line.
"""

import sys

from heronry_wire import interruption


def main() -> int:
    """Run the command line of this process; returns the exit code."""
    interruption.begin()
    from heronry_tools.cli import main as command_line  # noqa: PLC0415 - after `begin`

    try:
        interruption.running()
        return command_line()
    except KeyboardInterrupt:  # before or after the command itself
        return interruption.came()
    finally:
        interruption.finished()


if __name__ == "__main__":
    sys.exit(main())
