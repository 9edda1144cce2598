"""The planner in a process of its own, warm: the solver is loaded and the spec is read before the first request.

    python -m heronry_manager.planner.service FD

FD is an open file that holds the spec. Requests come on standard input and are answered in their order on what was
standard output; whatever else prints there goes to standard error. The verifier checks every plan before it is sent. An
error in a request is its answer; the process goes on.

The process ends without a message when standard input closes, which it does when the client has ended for any reason,
or when an answer can no longer be written. A thread waits for that, so that a search in progress does not outlive its
client. A request is cancelled by ending the process.
"""

import os
import sys
from queue import SimpleQueue
from threading import Thread
from typing import BinaryIO, NoReturn

from heronry_dg.loader import load
from heronry_dg.verify import verify
from heronry_manager.planner.exact import Planner
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


def main() -> None:
    """Serve until standard input closes."""
    answers = _own_standard_output()
    spec = load(f"/dev/fd/{int(sys.argv[1])}")
    lines: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_read_lines, args=(sys.stdin.buffer, lines), daemon=True).start()
    planner = Planner(spec)
    _send(answers, Ready())
    while True:
        _send(answers, answer(planner, lines.get()))


def answer(planner: Planner, line: bytes) -> Answer:
    """Answer one line of a client."""
    try:
        request = read_request(line, planner.spec)
    except MessageError as error:
        return Refusal(None, str(error))
    try:
        return _planned(planner, request)
    except Exception as error:  # noqa: BLE001 - a client waits: whatever went wrong is its answer
        return Refusal(request.number, f"the planner failed ({type(error).__name__}: {error})")


def _planned(planner: Planner, request: Request) -> Answer:
    found = planner.solved(request.now, request.running)
    violations = verify(planner.spec, request.now, found.best)
    if violations:
        return Refusal(request.number, f"the planner's own plan is not legal: {violations[0]}")
    return Solution(request.number, found.best, found.objective, found.bounds())


def _own_standard_output() -> BinaryIO:
    """Keep standard output for answers alone."""
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
    """End this process: the client is gone, and needs neither the search nor its answer."""
    os._exit(0)


if __name__ == "__main__":
    main()
