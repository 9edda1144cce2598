"""Makes the plans for every single fault in the background, while a demo flies without them; the next demo uses them.

    python -m heronry_tools.runtime.demo.planning_ahead SPEC      started by the demo, which holds its standard input

The process starts when the first configuration runs. It has a lower priority than the nodes (`_NICENESS`), and does not
preempt a process that has just woken (SCHED_BATCH). Its priority is not the lowest one: on a busy computer the lowest
one would leave it no time at all. It has no worker processes, since each would first have to load the solver. The plans
go into the user's cache (`made_ahead`). If the demo ends before all plans are made, the process ends with the demo. The
plans that were found are kept, and the next demo continues from them.

    waiting --start()--> planning --its end--> reported
                            |
                         close() ends the process

While a PE is suspected, or a plan or an epoch is under way, the demo stops the process, and lets it go on afterwards.
If the demo is killed meanwhile, the kernel kills the process. A stopped process cannot arrange that, so the process is
stopped only after it has: then it is SCHED_BATCH.
"""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

from heronry_dg.model import Spec
from heronry_manager.events import Event, PeAnswered, PeLost, PeSuspected
from heronry_tools.analysis.made_ahead import contingencies_of, found_so_far, kept_contingencies, questions
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.console.spec_files import load_spec
from heronry_wire.parent_death import die_with

_NICENESS = 5  # a third of the share of a process with nice value 0, a tenth of that of a node with NODE_PRIORITY


class PlanningAhead:
    """Starts and ends the process that makes the plans for single faults in the background of a demo."""

    def __init__(self, spec: Spec, file: Path) -> None:
        self._spec, self._file = spec, file
        self._process: subprocess.Popen[bytes] | None = None
        self._found_before = 0
        self._is_held = False
        self._suspected: set[str] = set()

    def start(self) -> str:
        """Start the process that makes the plans for every single fault; returns a sentence for the user."""
        self._found_before = found_so_far(self._spec)
        command = [sys.executable, "-m", __name__, str(self._file)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, process_group=0
        )
        return (
            f"the {questions(self._spec)} plans for every single fault are made in the background; "
            "this demo flies without them"
        )

    def follow(self, told: Event) -> None:
        """Note an event of the manager: which PEs it suspects."""
        if isinstance(told, PeSuspected):
            self._suspected.add(told.pe)
        elif isinstance(told, PeAnswered | PeLost):
            self._suspected.discard(told.pe)

    def pause_if(self, *, is_something_under_way: bool) -> None:
        """Stop the process (SIGSTOP) while a PE is suspected or something is under way; else let it go on."""
        is_held = is_something_under_way or bool(self._suspected)
        if is_held != self._is_held and self._process is not None and _ends_with_demo(self._process):
            self._is_held = is_held
            self._process.send_signal(signal.SIGSTOP if is_held else signal.SIGCONT)

    def outcome(self) -> str | None:
        """Return a sentence about the result on the first call after the process has ended; None on all others."""
        if self._process is None or self._process.poll() is None:
            return None
        process, self._process = self._process, None
        said = process.communicate()[0].decode(errors="replace").strip()
        if process.returncode == 0:
            return self._complete()
        last = said.rpartition("\n")[2].removeprefix("heronry: ") or f"exit code {process.returncode}"
        return f"the plans for every single fault were not made: {last}"

    def close(self) -> str | None:
        """End the process if it still plans, and return a sentence about its result.

        None if `outcome` has already returned this sentence, or if the process was never started.
        """
        outcome = self.outcome()
        process, self._process = self._process, None
        if process is None:
            return outcome
        process.kill()
        process.communicate()
        if kept_contingencies(self._spec) is not None:  # the process was about to end
            return self._complete()
        found = found_so_far(self._spec)
        kept = f"{found} of {questions(self._spec)} plans for single faults are made and kept"
        if found > self._found_before:
            return f"{kept}: the next demo continues"
        return (
            f"{kept}, none of them in this demo, which was too short for that on this computer: "
            "a longer one (--for 60) makes them"
        )

    def _complete(self) -> str:
        return f"the {questions(self._spec)} plans for every single fault are complete: the next demo uses them"


def _ends_with_demo(process: "subprocess.Popen[bytes]") -> bool:
    """Tell whether the process has arranged that it ends with the demo (`main`)."""
    return process.poll() is None and os.sched_getscheduler(process.pid) == os.SCHED_BATCH


def main() -> int:
    """Make and keep the plans for every single fault of a spec; returns the exit code.

    The code is 1 if the plans cannot be made or kept; a message on standard error gives the reason.
    """
    die_with(os.getppid())
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.setpriority(os.PRIO_PROCESS, 0, max(_NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))  # never back to a higher one
    threading.Thread(target=_end_with_demo, daemon=True).start()
    made = contingencies_of(load_spec(sys.argv[1]), Ahead.SINGLE_FAULTS, workers=1)  # itself: loading takes longest
    return 0 if made is not None else 1


def _end_with_demo() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
