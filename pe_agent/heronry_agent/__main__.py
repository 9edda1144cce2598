"""`python -m heronry_agent` is the program `pe-agent`.

Ctrl-C is handled before the slow imports begin, so that it never prints a traceback.
"""

import sys

from heronry_wire import interruption


def main() -> int:
    """Run `pe-agent` with the arguments of this process, and return its exit code."""
    interruption.begin()
    from heronry_agent.shell.cli import main as command_line  # noqa: PLC0415 - after `begin`

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
