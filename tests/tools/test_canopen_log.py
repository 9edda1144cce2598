"""A transfer that fails is one sentence: what canopen logs of it does not come to the terminal."""

import subprocess
import sys

FAILS = """
import logging
{first}
logging.getLogger("canopen.sdo.client").error("transfer aborted by the other end")
"""
OURS = "from heronry_tools.runtime.canopen_log import keep_off_the_terminal\nkeep_off_the_terminal()"


def said(first: str) -> str:
    """What a program prints to standard error whose transfer fails."""
    program = [sys.executable, "-c", FAILS.format(first=first)]
    return subprocess.run(program, stderr=subprocess.PIPE, text=True, check=True).stderr


def test_what_canopen_logs_stays_off_the_terminal_but_not_out_of_a_log_of_the_program() -> None:
    assert "transfer aborted" in said("")
    assert said(OURS) == ""
    assert "transfer aborted" in said(f"{OURS}\nlogging.basicConfig()")
