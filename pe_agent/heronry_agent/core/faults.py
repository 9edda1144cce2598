"""What this PE has to tell its manager until it was heard: faults found here, and requests for a phase (rule 8).

All of it goes out as EMCY. A message is *pending* from the moment of its cause until CONTROL acknowledges it; while it
is pending it is sent once in a heartbeat period, and the same cause adds nothing.

    fault           pending until its element is acknowledged. One that is still being reported after that, by a monitor
                    that runs 40 times a second, stays quiet for a second and is then pending again: the manager may
                    have healed the element in the meantime. What has been told of an element stays told until CONTROL
                    clears it; then it is told anew as soon as it is found, and an EMCY with code 0 takes it back.
    phase request   one at most: a newer one takes its place. Its number, in the detail, is what is acknowledged, so
                    that an answer to an older request ends nothing. Made again it has the same one: who knows of it
                    has obeyed it

A module that was only built anew is told the same way, is no fault that would stay told, and is acknowledged by itself:
it may have been given up since, and that has to be heard, too. What stays told is told again to every new reign, since
the one before may have acknowledged it, and died before anybody else knew. But where this PE has heard nobody for a
while since it was acknowledged (`tell_all_again`), it may have missed that it was cleared, and keeps it to itself,
unless that is a module which it would run (`tell_again`).

A fault of what may serve a function of class A is flight-critical: a CANaerospace emergency event goes out with every
EMCY. It says code, kind and index, these two in one signed byte each, and -1 where a number has no place there.

Lost: an EMCY or an acknowledgement costs a repetition; a CLEAR costs a second of quiet, and the next reign is told once
more what stayed told here: then it has to be cleared again. Late or doubled, nothing. After a pause what is due is sent
once. Forged: an acknowledgement silences a fault for a second. A restart forgets everything, and so does nobody else.
"""

from collections.abc import Collection
from dataclasses import replace

from heronry_agent.core.error_history import ErrorHistory
from heronry_wire.canaerospace import ErrorReport, encode_emergency_event
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import FORWARD_ONLY, REQUEST_NUMBERS, ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import FAULT_QUIET_NS
from heronry_wire.sansio import NEVER_NS

_NO_ERROR = 0x00
_ERROR_REGISTER = 0x81  # CiA 301 object 1001h: generic error, manufacturer specific
_LARGEST_BYTE = 127
_Key = tuple[FaultCode, ElementKind, int]


class Faults:
    """Pending faults and requests of one PE."""

    def __init__(self, node: int, period_ns: int, critical: Collection[tuple[ElementKind, int]] = ()) -> None:
        """`period_ns` is the heartbeat period of the bus on which EMCY goes out; `critical` are kinds and indices."""
        self._node, self._emcy_id = node, emcy_id(node)
        self._period_ns = period_ns
        self._critical = frozenset(critical)
        self._pending: dict[_Key, tuple[int, Emergency]] = {}  # when to send it again, and what
        self._quiet_until_ns: dict[_Key, int] = {}
        self._told: dict[tuple[int, int], tuple[Emergency, int]] = {}  # by kind, index; when found, or heard
        self._requests = self._events = 0
        self._request: Emergency | None = None  # the last one, if it stands
        self.changes = 0  # how often something became pending, or was no more
        self.history = ErrorHistory()
        self.next_ns = NEVER_NS

    @property
    def pending(self) -> bool:
        """Tell whether something waits for its acknowledgement."""
        return bool(self._pending)

    @property
    def is_asking(self) -> bool:
        """Tell whether a request for a phase waits for its acknowledgement."""
        return any(code is FaultCode.PHASE_REQUEST for code, _, _ in self._pending)

    def messages(self) -> list[bytes]:
        """Give every EMCY that waits for its acknowledgement, oldest first."""
        return [emergency.encode() for _, emergency in self._pending.values()]

    @property
    def register(self) -> int:
        """Error register of CANopen: whether some fault was told and not cleared."""
        return _ERROR_REGISTER if self._told else _NO_ERROR

    def found(self, code: FaultCode, kind: ElementKind, index: int, detail: int, now_ns: int) -> list[Frame]:
        """A fault was found: what to send now; nothing while it is pending or quiet."""
        key = (code, kind, index)
        if key in self._pending:
            return []
        if code is FaultCode.REPORTED and now_ns < self._quiet_until_ns.get(key, now_ns):
            return []
        emergency = Emergency(code, _ERROR_REGISTER, kind, index, min(max(detail, 0), 0xFFFF))
        if code is not FaultCode.MODULE_RESTARTED:
            self._told[kind, index] = emergency, now_ns
        self.history.add(code, kind, index)
        return self._pend(emergency, now_ns)

    def tell_again(self, kind: ElementKind, index: int, now_ns: int) -> list[Frame]:
        """Somebody else has to know what was told of an element, if it still stands: what to send now."""
        told = self._told.get((kind, index))
        return [] if told is None else self._pend(told[0], now_ns)

    def tell_all_again(self, since_ns: int, now_ns: int) -> list[Frame]:
        """Somebody else has to know what was found or heard of since a time, and still stands: what to send now."""
        told = [emergency for emergency, at_ns in self._told.values() if at_ns >= since_ns]
        return [frame for one in told if _key(one) not in self._pending for frame in self._pend(one, now_ns)]

    def request_phase(self, index: int, now_ns: int, *, forward_only: bool) -> list[Frame]:
        """A phase is asked for: what to send now. The request before it, if it still waits, is given up."""
        self.withdraw_request()
        self._requests = (self._requests + 1) % REQUEST_NUMBERS
        detail = self._requests | (FORWARD_ONLY if forward_only else 0)
        self._request = Emergency(FaultCode.PHASE_REQUEST, _NO_ERROR, ElementKind.PHASE, index, detail)
        return self._pend(self._request, now_ns)

    def repeat_request(self, now_ns: int) -> list[Frame]:
        """Somebody else has to know what was asked for last, if that stands: what to send now. It only leads on now."""
        if self._request is None:
            return []
        return self._pend(replace(self._request, detail=self._request.detail | FORWARD_ONLY), now_ns)

    def withdraw_request(self) -> None:
        """Ask for no phase any more."""
        self._request = None
        self._drop([key for key in self._pending if key[0] is FaultCode.PHASE_REQUEST])

    def acknowledge(self, kind: int, number: int, now_ns: int) -> bool:
        """The manager has heard a fault of an element, a restart or a request; tells whether that was pending."""
        heard = [key for key, (_, emergency) in self._pending.items() if emergency.acknowledgement == (kind, number)]
        for key in heard:
            self._quiet_until_ns[key] = now_ns + FAULT_QUIET_NS
            if key[0] is not FaultCode.MODULE_RESTARTED and key[1:] in self._told:
                self._told[key[1:]] = (self._told[key[1:]][0], now_ns)
        self._drop(heard)
        return bool(heard)

    def clear(self, kind: int, index: int) -> list[Frame]:
        """The operator takes an element for well: what to send now."""
        self._drop([key for key in self._pending if key[1:] == (kind, index)])
        self._quiet_until_ns = {key: ns for key, ns in self._quiet_until_ns.items() if key[1:] != (kind, index)}
        told = self._told.pop((kind, index), None)
        if told is None:
            return []
        emergency = replace(told[0], code=FaultCode.RESET, error_register=_NO_ERROR, detail=0)
        return [Frame(self._emcy_id, emergency.encode())]

    def tick(self, now_ns: int) -> list[Frame]:
        """Repeat what has not been acknowledged."""
        due = [emergency for at_ns, emergency in self._pending.values() if now_ns >= at_ns]
        return [frame for emergency in due for frame in self._pend(emergency, now_ns)]

    def _pend(self, emergency: Emergency, now_ns: int) -> list[Frame]:
        """Send this now, and again in a period."""
        key = _key(emergency)
        self.changes += key not in self._pending
        self._pending[key] = (now_ns + self._period_ns, emergency)
        self._find_next()
        frames = [Frame(self._emcy_id, emergency.encode())]
        if key[1:] in self._critical:
            frames.append(self._event(emergency))
        return frames

    def _event(self, emergency: Emergency) -> Frame:
        """CANaerospace emergency event of a fault (V1.7, p. 9)."""
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


def _key(emergency: Emergency) -> _Key:
    return emergency.code, emergency.kind, emergency.index
