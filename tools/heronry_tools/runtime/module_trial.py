"""Runs one module without a bus: builds it, and lets it compute some steps with the same inputs, as a partition would.

The module runs in this process, by the code that runs it in a partition (`heronry_agent.shell.module_runner`). Time is
the module's own: each step is one period after the step before, however long the computation takes here. Three
things count as a failure, as on a PE:

- an exception, or code that ends its process;
- a value that a partition would refuse to send;
- code that has not ended after a limit of time: an agent kills the partition of a module that hangs.
"""

import signal
import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from heronry_agent.core.vocabulary import Failure, KeptState, StateLacking, StateRestored, StateSaved
from heronry_agent.module import Datum, Module, Value
from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_agent.shell.module_runner import ModuleRunner, Orders, Result, is_foreign
from heronry_agent.shell.partition_messages import Done, Uncarriable, encode_answer
from heronry_agent.shell.time_limit import time_limit
from heronry_wire.checkpoint_frames import MOST_STATE_BYTES, SentState, frame_count
from heronry_wire.management import SPECS_PRIORITY
from heronry_wire.sansio import NEVER_NS

_MODULE = 0
_NS_PER_S = 1_000_000_000
_AGAIN_S = 0.5  # code that catches the exception by which it is ended gets the exception again after this time


@dataclass(slots=True)
class Trial:
    """The result of a trial.

    steps: the steps that the module has computed.
    failure: how the module failed; None if it did not fail.
    failed_in: if the module failed: number of the step in which it failed, from 1; 0: before step 1.
    longest_ns: the longest time that a step took.
    state: the state after the last step, or why it cannot be saved; None: the class has no `save` of its own.
    restored: whether a new object goes on from this state; None: there is no state.
    """

    steps: list[Result] = field(default_factory=list)
    failure: Failure | None = None
    failed_in: int = 0
    longest_ns: int = 0
    state: StateSaved | StateLacking | None = None
    restored: StateRestored | StateLacking | None = None

    @property
    def is_refused(self) -> bool:
        """Tell whether the state could not be restored."""
        return isinstance(self.restored, StateLacking)

    def document(self) -> dict[str, Any]:
        """Return the trial as plain data for JSON. Bytes become hexadecimal digits.

        A module may request that a function gets the priority of the spec again: then None stands for the priority.
        """
        failure = None
        if self.failure is not None:
            failure = {"in_step": self.failed_in, "reason": self.failure.reason, "traceback": self.failure.traceback}
        return {
            "v": 1,
            "ok": self.failure is None,
            "steps": [
                {
                    "outputs": {name: _plain(value) for name, value in one.outputs.items()},
                    "writes": [_plain(value) for value in one.writes],
                    "reports": [list(report) for report in one.reports],
                    "phases": list(one.phases),
                    "priorities": [list(request) for request in requested_priorities(one)],
                }
                for one in self.steps
            ],
            "failure": failure,
            "longest_step_ns": self.longest_ns,
            "state": None if self.state is None else _state_document(self.state, self.restored),
        }


def requested_priorities(step: Result) -> list[tuple[str, int | None]]:
    """Return function and priority of each priority request of a step; priority None: the spec's own priority."""
    return [(function, None if number == SPECS_PRIORITY else number) for function, number in step.priorities]


def expect_there(image: str) -> None:
    """Raise UnknownImageError if the code of an image is neither on Python's path nor in the present folder.

    If the code exists, but cannot be imported, nothing is raised here: the trial imports the code, too, and
    reports why that fails.
    """
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        find_image(image)
    except UnknownImageError as error:
        missing = error.__cause__
        if missing is None or (isinstance(missing, ModuleNotFoundError) and image.startswith(str(missing.name))):
            raise
    except Exception:  # noqa: BLE001 - foreign code; the trial tells of it
        return


def try_module(orders: Orders, inputs: Mapping[str, Value], reading: Value | None, steps: int, limit_s: float) -> Trial:
    """Build a module and step it; code that ends its process, or exceeds the limit, has failed, as on a PE.

    orders: the module's image, mode and period.
    inputs, reading: the variables, and the value of the device (None: no answer), that every step gets.
    limit_s: limit of time for the whole trial, in s.
    Raises UnknownImageError if there is no code of this image.
    """
    trial = Trial()
    try:
        with _limited(limit_s):
            expect_there(orders.image)
            _try(trial, orders, inputs, reading, steps)
    except _TooLongError as hung:
        trial.failure = Failure(f"it has not ended after {limit_s:g} s ({hung.place})", hung.stack)
    except SystemExit as end:
        trial.failure = Failure(f"SystemExit({end.code!r}): on a PE this ends the process, with all modules in it")
    return trial


class _TooLongError(BaseException):  # an Exception would be taken for one of the module's own
    """Raised where the code of the module has not ended in time; `place` and `stack` say where it was."""

    def __init__(self, frame: FrameType | None) -> None:
        super().__init__()
        self.place, self.stack = "", ""
        if frame is not None:
            self.place = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
            self.stack = "".join(["Stack (most recent call last):\n", *traceback.format_list(_own_frames(frame))])


def _own_frames(frame: FrameType) -> list[traceback.FrameSummary]:
    """Return the calls in the module's own code: the part of the call stack after the last function of the runner."""
    frames = traceback.extract_stack(frame)
    called = max((at for at, one in enumerate(frames) if not is_foreign(one.filename)), default=-1)
    return frames[called + 1 :]


@contextmanager
def _limited(limit_s: float) -> Iterator[None]:
    """Raise _TooLongError in the `with` block after `limit_s` seconds.

    Raise it again every `_AGAIN_S` seconds until the block ends.
    """

    def end(_number: int, frame: FrameType | None) -> None:
        raise _TooLongError(frame)

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, limit_s, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _try(trial: Trial, orders: Orders, inputs: Mapping[str, Value], reading: Value | None, steps: int) -> None:
    now_ns = 0
    runner = ModuleRunner(lambda: now_ns, time_limit)
    begun = runner.start(_MODULE, orders, now_ns)
    trial.failure = begun if isinstance(begun, Failure) else None
    leaves = {str(at): (name, Datum(value, 1, 0)) for at, (name, value) in enumerate(inputs.items())}
    while trial.failure is None and len(trial.steps) < steps:
        trial.failed_in = len(trial.steps) + 1
        begun_ns = time.perf_counter_ns()
        result = runner.step(_MODULE, now_ns, NEVER_NS, reading, leaves)
        trial.longest_ns = max(trial.longest_ns, time.perf_counter_ns() - begun_ns)
        trial.failure = result if isinstance(result, Failure) else _uncarriable(result)
        if isinstance(result, Result) and trial.failure is None:
            trial.steps.append(result)
        now_ns += orders.period_ns
    code = runner.code(_MODULE)
    if trial.failure is None and code is not None and type(code).save is not Module.save:
        _try_state(trial, runner, orders, now_ns)


def _try_state(trial: Trial, runner: ModuleRunner, orders: Orders, now_ns: int) -> None:
    """Save the state of the module, and let a new object go on from it."""
    trial.state = runner.save(_MODULE, 0, MOST_STATE_BYTES)
    if isinstance(trial.state, StateSaved) and trial.state.data:
        kept = KeptState(SentState.of(0, 0, trial.state.data, trial.state.code), now_ns, now_ns)
        outcome = runner.start(_MODULE, orders, now_ns, kept)
        trial.restored = outcome if isinstance(outcome, StateRestored | StateLacking) else None
        trial.failure = outcome if isinstance(outcome, Failure) else None


def read_value(text: str) -> Value:
    """Read a value as a module gets it: a whole number, a number, a list of whole numbers with commas, or a text."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    try:
        return tuple(int(part) for part in text.split(",")) if "," in text else text
    except ValueError:
        return text


def period_ns(rate_hz: float) -> int:
    """Return the time between two steps, in ns, for a rate in steps per second."""
    return round(_NS_PER_S / rate_hz)


def _uncarriable(result: Result) -> Failure | None:
    try:
        encode_answer(Done(_MODULE, 0, 0, result))
    except Uncarriable as error:
        return Failure(str(error))
    return None


def _state_document(state: StateSaved | StateLacking, restored: StateRestored | StateLacking | None) -> dict[str, Any]:
    lacking = next((one for one in (state, restored) if isinstance(one, StateLacking)), None)
    length = len(state.data) if isinstance(state, StateSaved) else None
    return {
        "bytes": length,
        "frames": None if not length else frame_count(length),
        "restored": isinstance(restored, StateRestored),
        "failure": None if lacking is None else {"kind": lacking.lack.name.lower(), "reason": lacking.reason},
    }


def _plain(value: Value) -> Any:
    return value.hex() if isinstance(value, bytes) else value
