"""What this PE reports of the states of its modules, by EMCY, for the events and the status of the manager.

    STATE_RESTORED   the module has started from its state. Sent three times, once a second
    STATE_LACKING    the module has started without a state: likewise. Or its state cannot be saved: once a second,
                     until it is saved or the module stops, since the manager forgets what is not repeated
                     (`module_notices`)

One report is sent in a heartbeat period, so that with a key the next page 0 proves it (`Faults.announce`). No manager
acknowledges it, so it is sent more than once. A later report of the module replaces those that wait. If many reports
wait, a copy may be late. One that comes more than MOST_LATE_NS late is not sent: the manager would count it as another
start.
"""

from collections import deque
from typing import NamedTuple

from heronry_agent.core.reports import Faults
from heronry_wire.frame import Frame
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.sansio import NEVER_NS

MOST_LATE_NS = 2_000_000_000

_TIMES = 3
_EVERY_NS = 1_000_000_000
_LASTS = -1  # times of a report that is repeated until it is over
_NO_ERROR = 0x00


class _Report(NamedTuple):
    due_ns: int
    module: int
    code: FaultCode
    detail: int
    times: int  # still to be sent


class StateReports:
    """The reports of one PE that are still to be sent."""

    def __init__(self, faults: Faults, period_ns: int) -> None:
        """Begin without reports; `period_ns` is the heartbeat period of the uplink."""
        self._faults, self._period_ns = faults, period_ns
        self._reports: deque[_Report] = deque()  # in the order of their times
        self._free_ns = 0  # when the next report may be sent

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`."""
        return max(self._free_ns, self._reports[0].due_ns) if self._reports else NEVER_NS

    def add(self, module: int, code: FaultCode, detail: int, now_ns: int, *, lasts: bool) -> None:
        """Report something in place of what waits of the module: three times or, if it `lasts`, until it is over."""
        report = _Report(now_ns, module, code, detail, _LASTS if lasts else _TIMES)
        if lasts and any(one._replace(due_ns=now_ns) == report for one in self._reports):
            return
        self._reports = deque(one for one in self._reports if one.module != module)
        self._insert(report)

    def over(self, module: int) -> None:
        """Repeat no more that the state of a module cannot be saved."""
        self._reports = deque(one for one in self._reports if (one.module, one.times) != (module, _LASTS))

    def tick(self, now_ns: int) -> Frame | None:
        """Return the report that is due now; None: it is a copy that is too late."""
        report = self._reports.popleft()
        if 0 < report.times < _TIMES and now_ns - report.due_ns > MOST_LATE_NS:
            return None
        self._free_ns = now_ns + self._period_ns
        if report.times != 1:
            times = _LASTS if report.times == _LASTS else report.times - 1
            self._insert(report._replace(due_ns=now_ns + _EVERY_NS, times=times))
        emergency = Emergency(report.code, _NO_ERROR, ElementKind.MODULE, report.module, report.detail)
        return self._faults.announce(emergency, now_ns)

    def _insert(self, report: _Report) -> None:
        self._reports = deque(sorted((*self._reports, report), key=lambda one: one.due_ns))
