"""`python -m heronry_agent` is the program `pe-agent`.

Interruptions are handled before anything is imported that takes long.
"""

import sys

from heronry_wire import interruption


def main() -> int:
    """Run the agent of this process; returns the exit code."""
    interruption.begin()
    from heronry_agent.shell.cli import main as command_line  # noqa: PLC0415 - after `begin`

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
