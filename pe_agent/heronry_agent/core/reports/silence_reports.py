"""Reports of this PE that an input or output of a module is silent, and that it is no longer (EMCY STALE).

    begun    reported as soon as possible, once more, and then every second while the silence lasts
    over     reported as soon as possible, and once more
    dropped  not reported: the new configuration does not have this input or output, or its module was started again

*As soon as possible* means: with the next heartbeat of this PE that has no earlier report to send. There is one report
in each heartbeat period, so that many silences at once do not fill the bus. As many silences are kept as can be
repeated within a second; `is_full` tells that there is no room for another.

No manager acknowledges a report. A manager ends a silence that has not been repeated for three and a half seconds. So
if a report is lost, it comes again; a doubled report has no effect; and a manager that restarts or takes over knows all
silences within a second. With a key the next page 0 proves the report (`faults`).
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from heronry_agent.core.reports.faults import Faults
from heronry_wire.frame import Frame
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import SILENCE_REPORT_NS
from heronry_wire.silence import Silence

_NO_ERROR = 0x00

_Key = tuple[int, Silence]  # index of the module, and which of its inputs or outputs


class SilenceReports:
    """Keeps the silences of one PE, and the order in which they are reported."""

    def __init__(self, faults: Faults, period_ns: int) -> None:
        """Begin without silences; `period_ns` is the heartbeat period of the uplink."""
        self._faults = faults
        self._most = max(1, SILENCE_REPORT_NS // period_ns)
        self._since_ns: dict[_Key, int] = {}
        self._told_ns: dict[_Key, int] = {}  # last report of each silence that was reported; the oldest first
        self._first: deque[_Key] = deque()  # to be reported first: begins and ends
        self._again: deque[_Key] = deque()  # to be reported once more

    @property
    def is_full(self) -> bool:
        """Tell whether there is no room for another silence."""
        return len(self._since_ns) >= self._most

    def silent(self) -> list[_Key]:
        """Return (index of the module, which input or output) of each silence."""
        return list(self._since_ns)

    def since_ns(self, module: int, silence: Silence) -> int | None:
        """Return the time in ns since which an input or output is silent; None: it is not."""
        return self._since_ns.get((module, silence)) if self._since_ns else None

    def is_told(self, module: int, silence: Silence) -> bool:
        """Tell whether a silence was reported."""
        return (module, silence) in self._told_ns

    def begun(self, module: int, silence: Silence, since_ns: int) -> None:
        """Note that an input or output is silent since `since_ns`; no effect while `is_full`."""
        if self.is_full:
            return
        key = module, silence
        self._since_ns[key] = since_ns
        self._forget_queued(key)
        self._first.append(key)

    def over(self, module: int, silence: Silence) -> None:
        """Note that a silence is over; no effect if there was none."""
        key = module, silence
        if self._since_ns.pop(key, None) is None:
            return
        was_told = self._told_ns.pop(key, None) is not None
        self._forget_queued(key)
        if was_told:
            self._first.append((module, replace(silence, is_over=True)))

    def drop(self, module: int, silence: Silence) -> None:
        """Forget a silence without a report."""
        key = module, silence
        self._since_ns.pop(key, None)
        self._told_ns.pop(key, None)
        self._forget_queued(key)

    def tick(self, now_ns: int) -> Iterable[Frame]:
        """Return the report that is to be sent in this heartbeat period, if there is one."""
        if self._first:
            key = self._first.popleft()
            self._again.append(key)
        elif self._again:
            key = self._again.popleft()
        else:
            due = next(iter(self._told_ns.items()), None)
            if due is None or now_ns - due[1] < SILENCE_REPORT_NS:
                return ()
            key = due[0]
        module, silence = key
        if not silence.is_over:
            self._told_ns.pop(key, None)
            self._told_ns[key] = now_ns
        emergency = Emergency(FaultCode.STALE, _NO_ERROR, ElementKind.MODULE, module, silence.detail)
        return (self._faults.announce(emergency, now_ns),)

    def _forget_queued(self, key: _Key) -> None:
        module, silence = key
        both = key, (module, replace(silence, is_over=True))
        self._first = deque(one for one in self._first if one not in both)
        self._again = deque(one for one in self._again if one not in both)
