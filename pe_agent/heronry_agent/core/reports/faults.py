"""Reports that this PE repeats until the manager acknowledges them: faults, and requests (protocol rule 8).

Each report is an EMCY. It is *pending* from its cause until the manager acknowledges it (CONTROL). A pending report is
sent again once in a heartbeat period. If its cause is found again meanwhile, no second report is made.

    fault           pending until its element is acknowledged. A monitor (which may run 40 times a second) may still
                    find the fault after that. For a second the fault is not reported; then it is pending again when it
                    is found, since the manager may have cleared the element in the meantime. A reported fault stays
                    *on record* until CONTROL clears it. Then an EMCY with code 0 ends the report, and the fault is
                    reported anew as soon as it is found
    phase request   at most one is pending: a newer request replaces it. The acknowledgement repeats the number of the
                    request, so that the answer to an older request does not end a newer one. A repeated request keeps
                    its number, so that a manager does not execute it twice
    priority        at most one request is pending for each function. It is handled like a phase request, but the
                    requests for each function have numbers of their own

A silent input or output (`silence_reports`) is only *announced*: its report is pending for one heartbeat period, and no
manager acknowledges it. At most one announcement is pending; a newer one replaces it.

Two more events are reported like faults, but do not stay on record:

- the restart of a module. It is acknowledged separately from the module's final failure, since the manager must learn
  of both;
- the suspicion of a module that a PE or a bus has failed. The manager assesses it.

*A new active manager.* The PE reports every fault on record to it (`tell_all_again`). The previous manager may have
acknowledged a fault, and failed before the standby manager learned of it. There is one exception: if this PE has been
cut off from all other nodes since the acknowledgement, it may have missed a CLEAR. Then it reports only faults of
modules that it does not run because of the fault (`tell_again`).

*Flight-critical faults.* A fault is flight-critical if its element may serve a function of class A. With every EMCY of
such a fault, the PE also sends a CANaerospace emergency event. The event carries the code of the fault, and the kind
and the index of the element in one signed byte each; -1 stands for an index that does not fit.

*Lost, late, doubled and forged frames.* If an EMCY or an acknowledgement is lost, the report is sent once more. If a
CLEAR is lost, the fault stays on record and is reported to the next active manager: the operator has to clear it again.
Late or doubled frames change nothing. After a pause of the process, each report that is due is sent once. After a
forged acknowledgement, the fault is not reported for a second. A restart of the PE empties this record; the manager
keeps its own record.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

from heronry_agent.core.reports.error_history import ErrorHistory
from heronry_wire.canaerospace import ErrorReport, encode_emergency_event
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import (
    FORWARD_ONLY,
    PRIORITY_REQUEST_NUMBERS,
    REQUEST_NUMBERS,
    ElementKind,
    Emergency,
    FaultCode,
)
from heronry_wire.protocol_times import FAULT_QUIET_NS
from heronry_wire.sansio import NEVER_NS

_NO_ERROR = 0x00
_ERROR_REGISTER = 0x81  # CiA 301 object 1001h: generic error, manufacturer specific
_LARGEST_BYTE = 127
_SUSPECTED = (ElementKind.PE, ElementKind.BUS)
_Key = tuple[FaultCode, ElementKind, int]


class Faults:
    """The reports of one PE that the manager has not acknowledged yet, and the faults that are not cleared yet."""

    def __init__(self, node: int, period_ns: int, critical: Collection[tuple[ElementKind, int]] = ()) -> None:
        """Begin without faults.

        period_ns: heartbeat period of the uplink.
        critical: (kind, index) of each flight-critical element.
        """
        self._node, self._emcy_id = node, emcy_id(node)
        self._period_ns = period_ns
        self._critical = frozenset(critical)
        self._pending: dict[_Key, tuple[int, Emergency]] = {}  # when to send the EMCY again, and the EMCY
        self._quiet_until_ns: dict[_Key, int] = {}
        # uncleared faults, by (kind, index): the EMCY, and when the fault was last found or acknowledged
        self._told: dict[tuple[int, int], tuple[Emergency, int]] = {}
        self._requests = self._events = 0
        self._announced: bytes | None = None  # the EMCY of the announcement that is pending
        self._announced_until_ns = NEVER_NS
        self._request: Emergency | None = None  # the last phase request, unless it was withdrawn
        self._priorities: dict[int, Emergency] = {}  # by function: the last priority request, unless it was withdrawn
        self._priority_numbers: dict[int, int] = {}  # by function
        self.changes = 0  # how often a report has become pending or ceased to be
        self.history = ErrorHistory()
        self.next_ns = NEVER_NS

    @property
    def pending(self) -> bool:
        """Tell whether any report has not been acknowledged yet, or was announced within the last heartbeat period."""
        return bool(self._pending) or self._announced is not None

    @property
    def is_asking(self) -> bool:
        """Tell whether a phase request has not been acknowledged yet."""
        return any(code is FaultCode.PHASE_REQUEST for code, _, _ in self._pending)

    def renumber(
        self, element: Callable[[ElementKind, int], int | None], critical: Collection[tuple[ElementKind, int]]
    ) -> None:
        """Give all elements the indices that they have in another table; what it does not have is forgotten.

        element: returns the new index of an element, None: it has none. critical: the flight-critical elements of that
        table, by their new indices.
        """

        def other(emergency: Emergency) -> Emergency | None:
            found = element(emergency.kind, emergency.index)
            return None if found is None else replace(emergency, index=found)

        self._critical = frozenset(critical)
        pending = [(at_ns, other(emergency)) for at_ns, emergency in self._pending.values()]
        self._pending = {_key(emergency): (at_ns, emergency) for at_ns, emergency in pending if emergency is not None}
        told = [(other(emergency), at_ns) for emergency, at_ns in self._told.values()]
        self._told = {(one.kind, one.index): (one, at_ns) for one, at_ns in told if one is not None}
        self._quiet_until_ns.clear()
        self._request = None if self._request is None else other(self._request)
        requests = [other(request) for request in self._priorities.values()]
        self._priorities = {one.index // PRIORITY_REQUEST_NUMBERS: one for one in requests if one is not None}
        numbers = self._priority_numbers
        self._priority_numbers = {
            found // PRIORITY_REQUEST_NUMBERS: number
            for function, number in numbers.items()
            if (found := element(ElementKind.PRIORITY, function * PRIORITY_REQUEST_NUMBERS)) is not None
        }
        self._announced, self._announced_until_ns = None, NEVER_NS
        self.changes += 1
        self._find_next()

    def messages(self) -> list[bytes]:
        """Return the EMCYs that are pending, as bytes: the oldest first, an announcement last."""
        pending = [emergency.encode() for _, emergency in self._pending.values()]
        return pending if self._announced is None else [*pending, self._announced]

    @property
    def register(self) -> int:
        """Error register of CANopen (object 1001h): not 0 while a reported fault is not cleared."""
        return _ERROR_REGISTER if self._told else _NO_ERROR

    def found(self, code: FaultCode, kind: ElementKind, index: int, detail: int, now_ns: int) -> list[Frame]:
        """Record a fault; returns the frames that report it.

        Returns no frames while an earlier report of the fault is not acknowledged. If the code is `FaultCode.REPORTED`
        (a module has reported the element), it also returns none for a second after the acknowledgement.
        """
        key = (code, kind, index)
        if key in self._pending:
            return []
        if code is FaultCode.REPORTED and now_ns < self._quiet_until_ns.get(key, now_ns):
            return []
        emergency = Emergency(code, _ERROR_REGISTER, kind, index, min(max(detail, 0), 0xFFFF))
        if code is not FaultCode.MODULE_RESTARTED and kind not in _SUSPECTED:
            self._told[kind, index] = emergency, now_ns
        self.history.add(code, kind, index)
        return self._pend(emergency, now_ns)

    def tell_again(self, kind: ElementKind, index: int, now_ns: int) -> list[Frame]:
        """Report the uncleared fault of an element once more; returns the frames to send now.

        Returns no frames if the element has no fault, or its fault was cleared.
        """
        told = self._told.get((kind, index))
        return [] if told is None else self._pend(told[0], now_ns)

    def tell_all_again(self, since_ns: int, now_ns: int) -> list[Frame]:
        """Report once more the uncleared faults that were found or acknowledged at `since_ns` or later.

        A fault whose report is not acknowledged yet is left out, since this report is repeated anyway. Returns the
        frames to send now.
        """
        told = [emergency for emergency, at_ns in self._told.values() if at_ns >= since_ns]
        return [frame for one in told if _key(one) not in self._pending for frame in self._pend(one, now_ns)]

    def request_phase(self, index: int, now_ns: int, *, forward_only: bool) -> list[Frame]:
        """Request a mission phase, and drop any earlier request; returns the frames to send now.

        forward_only: the manager is to ignore the request unless the requested phase may follow the present one. A
            phase with a phase rule may follow the phases in the rule's `from`; a phase without a rule may follow all
            phases before it in the spec.
        """
        self.withdraw_request()
        self._requests = (self._requests + 1) % REQUEST_NUMBERS
        detail = self._requests | (FORWARD_ONLY if forward_only else 0)
        self._request = Emergency(FaultCode.PHASE_REQUEST, _NO_ERROR, ElementKind.PHASE, index, detail)
        return self._pend(self._request, now_ns)

    def repeat_request(self, now_ns: int) -> list[Frame]:
        """Send the last phase request again, now with `forward_only` set (see `request_phase`).

        Returns the frames to send now; none if the request was withdrawn.
        """
        if self._request is None:
            return []
        return self._pend(replace(self._request, detail=self._request.detail | FORWARD_ONLY), now_ns)

    def withdraw_request(self) -> None:
        """Drop the last phase request, whether or not it was acknowledged."""
        self._request = None
        self._drop([key for key in self._pending if key[0] is FaultCode.PHASE_REQUEST])

    def request_priority(self, function: int, priority: int, now_ns: int) -> list[Frame]:
        """Request a priority of a function, and drop an earlier request for it; returns the frames to send now."""
        self.withdraw_priority(function)
        number = (self._priority_numbers.get(function, 0) + 1) % PRIORITY_REQUEST_NUMBERS
        self._priority_numbers[function] = number
        index = function * PRIORITY_REQUEST_NUMBERS + number
        request = Emergency(FaultCode.PRIORITY_REQUEST, _NO_ERROR, ElementKind.PRIORITY, index, priority)
        self._priorities[function] = request
        return self._pend(request, now_ns)

    def repeat_priority(self, function: int, now_ns: int) -> list[Frame]:
        """Send the last priority request for a function once more, unchanged; returns the frames to send now.

        Returns no frames while the request is not acknowledged, since such a request is repeated anyway.
        """
        request = self._priorities[function]
        return [] if _key(request) in self._pending else self._pend(request, now_ns)

    def withdraw_priority(self, function: int) -> None:
        """Drop the last request for the priority of a function, whether or not it was acknowledged."""
        request = self._priorities.pop(function, None)
        if request is not None and _key(request) in self._pending:
            self._drop([_key(request)])

    def announce(self, emergency: Emergency, now_ns: int) -> Frame:
        """Make a report pending for one heartbeat period, in place of the last one; returns the frame to send now."""
        self._announced, self._announced_until_ns = emergency.encode(), now_ns + self._period_ns
        self.changes += 1
        self._find_next()
        return Frame(self._emcy_id, self._announced)

    def acknowledge(self, kind: int, number: int, now_ns: int) -> bool:
        """Stop repeating the reports that the manager has acknowledged; tells whether there were any.

        kind, number: the fields of the acknowledgement (`Emergency.acknowledgement`).
        """
        heard = [key for key, (_, emergency) in self._pending.items() if emergency.acknowledgement == (kind, number)]
        for key in heard:
            self._quiet_until_ns[key] = now_ns + FAULT_QUIET_NS
            if key[0] is not FaultCode.MODULE_RESTARTED and key[1:] in self._told:
                self._told[key[1:]] = (self._told[key[1:]][0], now_ns)
        self._drop(heard)
        return bool(heard)

    def clear(self, kind: int, index: int) -> list[Frame]:
        """Clear the faults of an element.

        Returns the EMCY that ends the report of the faults; no frame if there was no fault.
        """
        self._drop([key for key in self._pending if key[1:] == (kind, index)])
        self._quiet_until_ns = {key: ns for key, ns in self._quiet_until_ns.items() if key[1:] != (kind, index)}
        told = self._told.pop((kind, index), None)
        if told is None:
            return []
        emergency = replace(told[0], code=FaultCode.RESET, error_register=_NO_ERROR, detail=0)
        return [Frame(self._emcy_id, emergency.encode())]

    def tick(self, now_ns: int) -> list[Frame]:
        """Return the frames of the reports that are to be repeated now; an announcement may cease to be pending."""
        if now_ns >= self._announced_until_ns:
            self._announced, self._announced_until_ns = None, NEVER_NS
            self._find_next()
        due = [emergency for at_ns, emergency in self._pending.values() if now_ns >= at_ns]
        return [frame for emergency in due for frame in self._pend(emergency, now_ns)]

    def _pend(self, emergency: Emergency, now_ns: int) -> list[Frame]:
        """Repeat a report in every heartbeat period from now on; returns the frames to send now."""
        key = _key(emergency)
        self.changes += key not in self._pending
        self._pending[key] = (now_ns + self._period_ns, emergency)
        self._find_next()
        frames = [Frame(self._emcy_id, emergency.encode())]
        if key[1:] in self._critical:
            frames.append(self._event(emergency))
        return frames

    def _event(self, emergency: Emergency) -> Frame:
        """Return the CANaerospace emergency event of a fault (CANaerospace V1.7, p. 9)."""
        index = emergency.index if emergency.index <= _LARGEST_BYTE else -1
        report = ErrorReport(emergency.code - 0x10000, emergency.kind, index)
        self._events = (self._events + 1) % 256
        return encode_emergency_event(self._node, report, message_code=(self._events - 1) % 256)

    def _drop(self, keys: list[_Key]) -> None:
        for key in keys:
            del self._pending[key]
        self.changes += len(keys)
        self._find_next()

    def _find_next(self) -> None:
        self.next_ns = min((at_ns for at_ns, _ in self._pending.values()), default=NEVER_NS)
        self.next_ns = min(self.next_ns, self._announced_until_ns)


def _key(emergency: Emergency) -> _Key:
    return emergency.code, emergency.kind, emergency.index
