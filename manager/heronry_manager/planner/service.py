"""The planner in a process of its own, which loads the solver and reads the spec before the first request.

    python -m heronry_manager.planner.service FD NAME

FD is the descriptor of an open file with the spec, and NAME the name of its file, after which a spec without a name is
called. Requests come on standard input, and the process answers them in
their order on standard output; other output of the process goes to standard error. The verifier checks every plan
before it is sent. If a request fails, its answer is the error, and the process goes on.

The process ends without a message when standard input closes (then its client has ended), or when an answer can no
longer be written. A thread waits for the end of standard input, so that a search in progress ends with the client. To
cancel a request, a client ends the process.

A client may also stop the process (SIGSTOP) and let it go on. A stopped process cannot notice that its client has
ended, so the kernel kills it then. That is arranged before the solver is loaded, and a client stops no process that has
not said that it is ready.
"""

import os
import sys
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, BinaryIO, NoReturn

from heronry_dg.loader import load_bytes
from heronry_dg.verify import verify
from heronry_manager.planner.messages import (
    Answer,
    MessageError,
    Ready,
    Refusal,
    Request,
    Solution,
    answer_line,
    read_request,
)
from heronry_wire.parent_death import die_with

if TYPE_CHECKING:
    from heronry_manager.planner.exact import Planner


def main() -> None:
    """Answer requests for plans until standard input closes."""
    die_with(os.getppid())
    from heronry_manager.planner.exact import Planner  # noqa: PLC0415 - loads the solver

    answers = _own_standard_output()
    spec = load_bytes(Path(f"/dev/fd/{int(sys.argv[1])}").read_bytes(), sys.argv[2])
    lines: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_read_lines, args=(sys.stdin.buffer, lines), daemon=True).start()
    planner = Planner(spec)
    _send(answers, Ready())
    while True:
        _send(answers, answer(planner, lines.get()))


def answer(planner: "Planner", line: bytes) -> Answer:
    """Answer one request, given as a line; a request that fails gets the error as its answer."""
    try:
        request = read_request(line, planner.spec)
    except MessageError as error:
        return Refusal(None, str(error))
    try:
        return _planned(planner, request)
    except Exception as error:  # noqa: BLE001 - the client waits for an answer
        return Refusal(request.number, f"the planner failed ({type(error).__name__}: {error})")


def _planned(planner: "Planner", request: Request) -> Answer:
    found = planner.solved(request.now, request.running)
    violations = verify(planner.spec, request.now, found.best)
    if violations:
        return Refusal(request.number, f"the planner's own plan is not legal: {violations[0]}")
    return Solution(request.number, found.best, found.objective, found.bounds())


def _own_standard_output() -> BinaryIO:
    """Return a stream to standard output that only answers use.

    From now on, everything else that this process prints goes to standard error.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers


def _read_lines(source: BinaryIO, lines: "SimpleQueue[bytes]") -> None:
    for line in source:
        lines.put(line)
    _end()


def _send(answers: BinaryIO, message: Answer) -> None:
    try:
        answers.write(answer_line(message))
        answers.flush()
    except BrokenPipeError:
        _end()


def _end() -> NoReturn:
    """End this process immediately, since its client has ended."""
    os._exit(0)


if __name__ == "__main__":
    main()
