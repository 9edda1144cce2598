"""Somebody with a CANopen tool and a CANaerospace tool at one PE, in flight or on a desk: reads, writes, and errs.

Whatever is said to a PE this way must not be felt by anybody who flies, and is answered by the book. The technician
knows the book (CiA 301, CANaerospace V1.7, docs/canopen.md) and the PE's table, listens to its state frames, and asks
no core. What is wrong is told (`wrong`), once, and the inspection ends there.

    in flight   the PE is configured: everything can be read, NMT is refused, a table is not taken
    on a desk   it runs nothing and hears no manager: NMT works, and its own table may be written anew

What is inspected follows from what its heartbeat says. An inspection takes some seconds; what it has set, it sets back.
"""

from collections.abc import Callable, Generator, Mapping
from itertools import pairwise

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.sdo_talk import SdoTalk, Talk, WrongAnswerError
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.canaerospace import DataType
from heronry_wire.canopen_objects import (
    COUNTERS,
    DEVICE_NAME,
    ERROR_HISTORY,
    ERROR_REGISTER,
    HEARTBEAT_MS,
    HEARTBEAT_TIME,
    MODULE_IMAGES,
    MODULE_INDICES,
    MODULE_MODES,
    MODULE_NAMES,
    MODULE_STATES,
    OBJECTS,
    PROGRAM_CONTROL,
    PROGRAM_DATA,
    REIGN,
    SPEC,
    STATE,
    STORED_EDS,
    TABLE,
    TIME,
    Access,
    Entry,
    Kind,
)
from heronry_wire.eds import eds_text
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import IDENTIFICATION
from heronry_wire.identifiers import (
    MANAGER_NODES,
    NMT_ID,
    Command,
    heartbeat_id,
    management_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import NO_EPOCH, Lease, decode_command
from heronry_wire.nmt import decode_heartbeat
from heronry_wire.node_services import (
    BROADCAST,
    Result,
    Service,
    ServiceMessage,
    decode_service,
    encode_service,
    read_identification,
    request,
    service_id,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received
from heronry_wire.sdo import (
    ABORT,
    BLOCK_DOWNLOAD,
    BLOCK_INITIATE,
    BLOCK_START,
    BLOCK_UPLOAD,
    DOWNLOAD,
    DOWNLOAD_ANSWER,
    EXPEDITED,
    SEGMENT_DOWNLOAD,
    SEGMENT_UPLOAD,
    SIZE_GIVEN,
    TOGGLE,
    UPLOAD,
    Abort,
    segment,
    with_data,
    with_number,
)
from heronry_wire.state_frames import StatePage0, StatePage1, decode_state

_MS = 1_000_000
_REQUESTS, _ANSWERS = service_id(0, is_answer=False), service_id(0, is_answer=True)
_BOOT_UP, _STOPPED, _OPERATIONAL, _PRE_OPERATIONAL = 0, 4, 5, 127
_START, _STOP, _ENTER_PRE_OPERATIONAL, _RESET, _RESET_COMMUNICATION = 1, 2, 128, 129, 130
_SHORT_MS, _SLOW_MS = 100, 250
_STAMP = 0x12345678
_MODULE_ARRAYS = (MODULE_NAMES, MODULE_INDICES, MODULE_IMAGES, MODULE_STATES, MODULE_MODES)
_WAIT_NS = 100 * _MS
_RUNNING, _NOT_WANTED = 1, 0


class Technician:
    """Inspects one PE from now on, until all has been seen or he leaves."""

    def __init__(
        self,
        clock: Clock,
        bus: SimulatedBus,
        table: PeTable,
        running: Callable[[], Mapping[str, str]],
        wrong: Callable[[str], None],
    ) -> None:
        """running: gives the modules that are planned on the PE, with their modes. wrong: is told what is wrong."""
        self._clock, self._bus, self._table, self._running, self._wrong = clock, bus, table, running, wrong
        self._node = table.node_id
        self._sdo = SdoTalk(self._node)
        self._heartbeats: list[tuple[int, int]] = []  # when, and what it said
        self._pages_0: list[tuple[int, StatePage0]] = []
        self._pages_1: list[tuple[int, StatePage1]] = []
        self._lease: tuple[int, Lease] | None = None
        self._awaited, self._asked = -1, 0
        self._lease_ids = {management_id(node, Command.LEASE): node for node in MANAGER_NODES}
        wants = {
            sdo_response_id(self._node),
            _ANSWERS,
            heartbeat_id(self._node),
            state_id(self._node),
            *self._lease_ids,
        }
        self._station = bus.join(f"{STRANGER}technician", 0, self._hear, frozenset(wants))
        self._talk: Generator[tuple[Frame | None, int, int], bytes | None, None] | None = self._inspection()
        self._go(None)

    @property
    def is_done(self) -> bool:
        """Tell whether everything has been seen."""
        return self._talk is None

    def leave(self) -> None:
        """Leave the bus."""
        self._talk = None
        if self._station.present:
            self._bus.leave(self._station)

    # The talk goes on with an answer, or when one has been waited for long enough

    def _go(self, answer: bytes | None) -> None:
        talk = self._talk
        if talk is None:
            return
        try:
            frame, self._awaited, patience_ns = talk.send(answer)
        except StopIteration:
            self._talk = None
            return
        except (WrongAnswerError, ValueError) as error:
            self._talk = None
            self._wrong(f"{self._table.name}: {error}")
            return
        if frame is not None:
            self._bus.offer(self._station, frame)
        self._asked += 1
        asked = self._asked
        self._clock.at(self._clock.now_ns + patience_ns, lambda: self._go(None) if asked == self._asked else None)

    def _hear(self, event: Received) -> None:
        frame, now_ns = event.frame, self._clock.now_ns
        if frame.can_id == heartbeat_id(self._node):
            self._heartbeats.append((now_ns, decode_heartbeat(frame.data)))
        elif frame.can_id == state_id(self._node):
            page = decode_state(frame.data)
            if isinstance(page, StatePage0):
                self._pages_0.append((now_ns, page))
            elif isinstance(page, StatePage1):
                self._pages_1.append((now_ns, page))
        elif frame.can_id in self._lease_ids:
            lease = decode_command(Command.LEASE, frame.data)
            if not isinstance(lease, Malformed):
                assert isinstance(lease, Lease)
                self._lease = self._lease_ids[frame.can_id], lease
        if frame.can_id == self._awaited:
            self._go(frame.data)

    # What is inspected

    def _inspection(self) -> Talk[None]:
        yield from self._wait(1_100)  # a heartbeat, and all pages of the state
        _demand(bool(self._heartbeats), "its heartbeat is not heard")
        is_flying = self._pages_0[-1][1].epoch != NO_EPOCH
        _demand(
            self._heartbeats[-1][1] == (_OPERATIONAL if is_flying else _PRE_OPERATIONAL),
            f"its heartbeat says {self._heartbeats[-1][1]}",
        )
        yield from self._constants()
        yield from self._present_state(is_flying=is_flying)
        yield from self._long_texts()
        yield from self._refusals(is_flying=is_flying)
        yield from self._mistakes()
        yield from self._heartbeat_time()
        yield from self._node_services()
        if is_flying:
            yield from self._nmt_in_flight()
        else:
            yield from self._writing_the_table()
            yield from self._nmt_on_a_desk()
        yield from self._present_state(is_flying=is_flying)

    def _wait(self, ms: int) -> Talk[None]:
        yield None, -1, ms * _MS

    def _read(self, index: int, sub_index: int, wanted: bytes | int | Abort) -> Talk[None]:
        """Read an object that says this; a number in as many bytes as there are."""
        found = yield from self._sdo.upload(index, sub_index)
        same = wanted == (
            int.from_bytes(found, "little") if isinstance(wanted, int) and isinstance(found, bytes) else found
        )
        _demand(same, f"object {index:04X}h, {sub_index} says {found!r} and not {wanted!r}")

    def _constants(self) -> Talk[None]:
        """What is always so, object by object: values, lengths, rights, and what there is not."""
        for entry in OBJECTS:
            last = entry.most if entry.kind is Kind.ARRAY else len(entry.variables)
            every = (0,) if entry.kind in (Kind.VAR, Kind.DOMAIN) else range(last + 2)
            for sub_index in (0, 1, last + 1) if entry.kind is Kind.ARRAY else every:
                yield from self._constant(entry, sub_index)
        yield from self._read(DEVICE_NAME, 1, Abort.NO_SUB_INDEX)
        yield from self._read(0x5000, 0, Abort.NO_OBJECT)
        yield from self._read(PROGRAM_CONTROL, 1, 1)
        yield from self._read(SPEC, 1, self._table.name.encode())
        yield from self._read(SPEC, 2, self._table.spec.encode())
        yield from self._read(SPEC, 3, self._table.spec_digest.encode())

    def _constant(self, entry: Entry, sub_index: int) -> Talk[None]:
        variable = entry.variable(sub_index)
        if variable is None:
            yield from self._read(entry.index, sub_index, Abort.NO_SUB_INDEX)
        elif variable.access is Access.WRITE:
            yield from self._read(entry.index, sub_index, Abort.WRITE_ONLY)
        elif isinstance(variable.value, str):
            yield from self._read(entry.index, sub_index, variable.value.encode())
        elif variable.value is not None and variable.access in (Access.CONST, Access.READ):
            yield from self._read(entry.index, sub_index, variable.value + self._node * variable.of_node)
        elif variable.type.length is not None and entry.kind is not Kind.ARRAY:
            found = yield from self._sdo.upload(entry.index, sub_index)
            fits = isinstance(found, bytes) and len(found) == variable.type.length
            _demand(fits, f"object {entry.index:04X}h, {sub_index} is {found!r}")

    def _present_state(self, *, is_flying: bool) -> Talk[None]:
        """What changes: as its state frames, the LEASE and the plan say."""
        page, staged = self._pages_0[-1][1], self._pages_1[-1][1]
        told = (
            *(page.state, page.flags, page.incarnation, page.epoch, page.digest, None, staged.staged_epoch),
            *(staged.staged_digest, staged.reason.value, staged.load),
        )
        for sub_index, value in enumerate(told, start=1):
            if value is not None:
                yield from self._read(STATE, sub_index, int(value))
        manager, lease = self._lease or (0, None)
        for sub_index, value in enumerate((manager, 0 if lease is None else lease.term), start=1):
            if manager and is_flying:
                yield from self._read(REIGN, sub_index, value)
        yield from self._read(REIGN, 3, int(is_flying))
        modules, running = self._table.modules, self._running() if is_flying else {}
        for position, module in enumerate(modules, start=1):
            mode = running.get(module.name)
            yield from self._read(MODULE_NAMES, position, module.name.encode())
            yield from self._read(MODULE_INDICES, position, module.index)
            yield from self._read(MODULE_IMAGES, position, module.image.encode())
            yield from self._read(MODULE_STATES, position, _NOT_WANTED if mode is None else _RUNNING)
            yield from self._read(MODULE_MODES, position, b"" if mode is None else mode.encode())
        for array in _MODULE_ARRAYS:
            yield from self._read(array, 0, len(modules))
            yield from self._read(array, len(modules) + 1, Abort.NO_DATA)
        yield from self._read(ERROR_REGISTER, 0, 0)
        yield from self._read(ERROR_HISTORY, 0, 0)
        yield from self._read(ERROR_HISTORY, 1, Abort.NO_DATA)
        yield from self._read(COUNTERS, 2, 0)

    def _long_texts(self) -> Talk[None]:
        """By segments and by blocks, with segments lost."""
        sdo, eds, table = self._sdo, eds_text().encode(), self._table.to_json().encode()
        yield from self._read(STORED_EDS, 0, eds)
        for size, lost in ((127, 0), (16, 3), (1, 0)):
            found = yield from sdo.upload_by_block(TABLE, 0, size, lost)
            _demand(found == table, f"by blocks of {size} its table is another one")
        found = yield from sdo.upload_by_block(DEVICE_NAME, 0, 5)
        _demand(found == b"heronry PE", f"by block its name is {found!r}")
        for size in (0, 128):
            found = yield from sdo.upload_by_block(TABLE, 0, size)
            _demand(found is Abort.BLOCK_SIZE, f"a block of {size} segments is sent")
        found = yield from sdo.upload_by_block(0x5000, 0, 5)
        _demand(found is Abort.NO_OBJECT, "there is an object 5000h")

    def _refusals(self, *, is_flying: bool) -> Talk[None]:
        """What may not be written, or not so."""
        wrong: tuple[tuple[int, int, bytes, Abort], ...] = (
            (DEVICE_NAME, 0, b"mine", Abort.READ_ONLY),
            (STATE, 1, b"\1", Abort.READ_ONLY),
            (PROGRAM_CONTROL, 1, b"\0", Abort.UNSUPPORTED),
            (PROGRAM_DATA, 1, bytes(20), Abort.UNSUPPORTED),
            (0x5000, 0, b"\1", Abort.NO_OBJECT),
            (STATE, 11, b"\1", Abort.NO_SUB_INDEX),
            (HEARTBEAT_TIME, 0, b"\1", Abort.LENGTH),
            (HEARTBEAT_TIME, 0, (_SHORT_MS - 1).to_bytes(2, "little"), Abort.VALUE),
            (ERROR_HISTORY, 0, b"\1", Abort.VALUE),
            (TABLE, 0, b"another table", Abort.DEVICE_STATE),
        )
        for index, sub_index, data, reason in wrong:
            found = yield from self._sdo.download(index, sub_index, data)
            _demand(found is reason, f"writing to {index:04X}h, {sub_index}: {found}")
        found = yield from self._sdo.download_by_block(TABLE, 0, b"another table")
        _demand(found is Abort.DEVICE_STATE, f"a table is taken by block: {found}")
        found = yield from self._sdo.download(ERROR_HISTORY, 0, b"\0")
        _demand(found is None, f"the error history is not emptied: {found}")
        if not is_flying:
            huge = with_number(DOWNLOAD | SIZE_GIVEN, TABLE, 0, (1 << 20) + 1)
            yield from self._sdo.refused(huge, Abort.OUT_OF_MEMORY, TABLE)

    def _mistakes(self) -> Talk[None]:
        """What has no place where it is said; the transfer that was under way is over each time."""
        sdo = self._sdo
        first, next_one = with_data(UPLOAD, STORED_EDS, 0), segment(SEGMENT_UPLOAD, b"")
        yield from sdo.refused(segment(SEGMENT_UPLOAD, b""), Abort.COMMAND)
        yield from sdo.refused(segment(SEGMENT_DOWNLOAD, b""), Abort.COMMAND)
        yield from sdo.refused(segment(BLOCK_UPLOAD | BLOCK_START, b""), Abort.COMMAND)
        yield from sdo.refused(segment(BLOCK_DOWNLOAD | 1, b""), Abort.COMMAND)
        yield from sdo.refused(with_data(7 << 5, DEVICE_NAME, 3), Abort.COMMAND, DEVICE_NAME, 3)
        yield from sdo.ask(first)
        yield from sdo.refused(segment(SEGMENT_UPLOAD | TOGGLE, b""), Abort.TOGGLE, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.ask(next_one)
        yield from sdo.refused(next_one, Abort.TOGGLE, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.refused(segment(SEGMENT_DOWNLOAD, b""), Abort.COMMAND, STORED_EDS)
        yield from sdo.ask(first)
        yield from sdo.say(segment(ABORT, b""))
        yield from sdo.refused(next_one, Abort.COMMAND)
        yield from sdo.say(b"\x40\x00\x10\x00\x00\x00\x00")  # seven bytes are no request
        yield from sdo.ask(first)
        yield from self._given_up(STORED_EDS)
        yield from sdo.ask(with_data(BLOCK_UPLOAD | BLOCK_INITIATE, STORED_EDS, 0, b"\x05"))
        yield from self._given_up(STORED_EDS)
        half = with_data(DOWNLOAD | EXPEDITED, HEARTBEAT_TIME, 0, HEARTBEAT_MS.to_bytes(4, "little"))
        answer = yield from sdo.ask(half)  # its length is not said: as long as the object is
        _demand(
            answer == with_data(DOWNLOAD_ANSWER, HEARTBEAT_TIME, 0), f"a half of a word is answered with {answer!r}"
        )

    def _given_up(self, index: int) -> Talk[None]:
        """A transfer that is not gone on with is given up after a second, and said to be."""
        answer = yield None, sdo_response_id(self._node), 900 * _MS
        _demand(answer is None, "it does not wait for a second")
        answer = yield None, sdo_response_id(self._node), 110 * _MS
        _demand(
            answer == with_number(ABORT, index, 0, Abort.TIME_OUT.value),
            f"a transfer is given up with {answer.hex(' ') if answer else answer}",
        )

    def _heartbeat_time(self) -> Talk[None]:
        """Its heartbeat comes as often as it is told; never, if it is told 0."""
        for time_ms in (_SHORT_MS, 0, _SLOW_MS, HEARTBEAT_MS):
            found = yield from self._sdo.download(HEARTBEAT_TIME, 0, time_ms.to_bytes(2, "little"))
            _demand(found is None, f"a heartbeat time of {time_ms} ms is refused: {found}")
            yield from self._read(HEARTBEAT_TIME, 0, time_ms)
            yield from self._beats_every(time_ms)

    def _beats_every(self, time_ms: int) -> Talk[None]:
        self._heartbeats.clear()
        begun_ns = self._clock.now_ns
        yield from self._wait(4 * time_ms + 20 if time_ms < HEARTBEAT_MS else HEARTBEAT_MS + 20)
        times = [t for t, _ in self._heartbeats]
        if time_ms == 0:
            _demand(times == [], "a heartbeat of 0 ms is heard")
            return
        gaps = [later - earlier for earlier, later in pairwise(times)]
        _demand(all(abs(gap - time_ms * _MS) < 3 * _MS for gap in gaps), f"its heartbeat comes after {gaps} ns")
        _demand(
            bool(times) and times[0] - begun_ns <= (time_ms + 3) * _MS, f"its heartbeat of {time_ms} ms does not come"
        )

    # CANaerospace node services

    def _node_services(self) -> Talk[None]:
        yield from self._identification()
        stamp = request(Service.NSS, BROADCAST, data_type=DataType.ULONG, value=_STAMP)
        yield encode_service(stamp), _ANSWERS, 20 * _MS
        yield from self._read(TIME, 1, _STAMP)
        found = yield from self._sdo.upload(TIME, 2)
        age_ms = int.from_bytes(found, "little") if isinstance(found, bytes) else -1
        _demand(20 <= age_ms < 500, f"the time stamp is {age_ms} ms old")
        yield from self._interval(heartbeat_id(self._node), _SHORT_MS, Result.OK)
        yield from self._beats_every(_SHORT_MS)
        yield from self._interval(heartbeat_id(self._node), _SHORT_MS - 1, Result.OUT_OF_RANGE)
        yield from self._interval(state_id(self._node), _SLOW_MS, Result.OUT_OF_RANGE)
        yield from self._interval(heartbeat_id(self._node), HEARTBEAT_MS, Result.OK)
        yield from self._state_transmission()
        for service, node in ((Service.SCS, self._node), (Service.TIS, self._node + 1), (Service.TIS, BROADCAST)):
            value = (heartbeat_id(self._node), _SHORT_MS)
            unheeded = request(service, node, data_type=DataType.SHORT2, value=value)
            answer = yield from self._service(unheeded, 20)
            is_its = answer is not None and answer.datum.node_id == self._node
            _demand(not is_its, f"{service.name} to {node} is answered with {answer}")
        yield Frame(_REQUESTS, b"\0\0"), _ANSWERS, 20 * _MS
        yield from self._read(HEARTBEAT_TIME, 0, HEARTBEAT_MS)

    def _identification(self) -> Talk[None]:
        answer = yield from self._service(request(Service.IDS, self._node, message_code=7), 10)
        is_right = answer is not None and read_identification(answer) == IDENTIFICATION
        _demand(is_right and answer is not None and answer.datum.message_code == 7, f"IDS is answered with {answer}")
        begun_ns = self._clock.now_ns
        answer = yield from self._service(request(Service.IDS, BROADCAST), 60)
        while answer is not None and answer.datum.node_id != self._node:
            answer = _read_service((yield None, _ANSWERS, 60 * _MS))
        late_ns = self._clock.now_ns - begun_ns - (self._node - 92) * _MS
        _demand(answer is not None and 0 <= late_ns < 5 * _MS, f"IDS to all is answered {late_ns} ns late: {answer}")
        yield from self._wait(60)  # until the others have answered

    def _interval(self, identifier: int, time_ms: int, result: Result) -> Talk[None]:
        asked = request(Service.TIS, self._node, data_type=DataType.SHORT2, value=(identifier, time_ms))
        answer = yield from self._service(asked, 20)
        said = None if answer is None else answer.datum.message_code
        _demand(said == result.message_code, f"an interval of {time_ms} ms for {identifier} is answered with {said}")

    def _state_transmission(self) -> Talk[None]:
        """STS: both pages at once, but not more often than once in a heartbeat period."""
        period_ns = self._table.ports[self._table.uplink].heartbeat_ns
        yield from self._wait(2 * period_ns // _MS)
        seen, begun_ns = len(self._pages_0), self._clock.now_ns
        yield encode_service(request(Service.STS, self._node)), -1, 3 * _MS
        pages = [page for t, page in (*self._pages_0[-2:], *self._pages_1[-2:]) if t > begun_ns]
        _demand(len(self._pages_0) > seen and len(pages) >= 2, "STS is not followed by the whole state")
        seen = len(self._pages_0)
        for _ in range(3):
            yield encode_service(request(Service.STS, self._node)), -1, 1 * _MS
        _demand(len(self._pages_0) - seen <= 1, "STS is followed more often than once in a period")
        yield from self._wait(2 * period_ns // _MS)

    def _service(self, asked: ServiceMessage, ms: int) -> Talk[ServiceMessage | None]:
        return _read_service((yield encode_service(asked), _ANSWERS, ms * _MS))

    # NMT

    def _nmt_in_flight(self) -> Talk[None]:
        """Nothing is obeyed: the heart beats on, and says that it is operational."""
        for command in (_STOP, _ENTER_PRE_OPERATIONAL, _RESET, _RESET_COMMUNICATION, _START, 77):
            for node in (self._node, BROADCAST):
                yield Frame(NMT_ID, bytes((command, node))), -1, 2 * _MS
        yield Frame(NMT_ID, bytes((_STOP,))), -1, 2 * _MS
        self._heartbeats.clear()
        yield from self._wait(HEARTBEAT_MS + 20)
        said = {value for _, value in self._heartbeats}
        _demand(said == {_OPERATIONAL}, f"after NMT commands in flight its heartbeat says {said}")

    def _nmt_on_a_desk(self) -> Talk[None]:
        """Every command works, and only where it is meant for this node."""
        yield from self._sdo.download(HEARTBEAT_TIME, 0, _SHORT_MS.to_bytes(2, "little"))
        yield from self._commanded(_START, self._node, [_OPERATIONAL])
        yield from self._commanded(_STOP, self._node + 1, [_OPERATIONAL])
        yield from self._commanded(77, self._node, [_OPERATIONAL])
        yield from self._commanded(_STOP, self._node, [_STOPPED])
        yield from self._sdo.say(with_data(UPLOAD, DEVICE_NAME, 0), _WAIT_NS)
        yield from self._commanded(_ENTER_PRE_OPERATIONAL, BROADCAST, [_PRE_OPERATIONAL])
        yield from self._read(DEVICE_NAME, 0, b"heronry PE")
        for reset in (_RESET, _RESET_COMMUNICATION):
            yield from self._sdo.download(HEARTBEAT_TIME, 0, _SHORT_MS.to_bytes(2, "little"))
            yield from self._wait(_SHORT_MS)
            yield from self._sdo.ask(with_data(UPLOAD, STORED_EDS, 0))
            yield from self._commanded(reset, self._node, [_BOOT_UP])
            yield from self._sdo.refused(segment(SEGMENT_UPLOAD, b""), Abort.COMMAND)
            yield from self._read(HEARTBEAT_TIME, 0, HEARTBEAT_MS)
            yield from self._commanded(_ENTER_PRE_OPERATIONAL, self._node, [_PRE_OPERATIONAL], HEARTBEAT_MS)

    def _commanded(self, command: int, node: int, said: list[int], time_ms: int = _SHORT_MS) -> Talk[None]:
        self._heartbeats.clear()
        yield Frame(NMT_ID, bytes((command, node))), -1, (time_ms + 10) * _MS
        heard = [value for _, value in self._heartbeats]
        _demand(heard == said, f"after NMT command {command} to {node} its heartbeat says {heard}, and not {said}")

    def _writing_the_table(self) -> Talk[None]:
        """It has one, and takes no other; its own may be written again, by whatever way."""
        own, sdo = self._table.to_json().encode(), self._sdo
        for written in (own, b" " + own + b"\n"):
            found = yield from sdo.download(TABLE, 0, written)
            _demand(found is None, f"its own table is not taken: {found}")
        found = yield from sdo.download_by_block(TABLE, 0, own, loses=3)
        _demand(found is None, f"its own table is not taken by blocks: {found}")
        found = yield from sdo.download_by_block(TABLE, 0, own, checksum=1)
        _demand(found is Abort.CRC, f"a wrong checksum is answered with {found}")
        found = yield from sdo.download_by_block(TABLE, 0, b"another table")
        _demand(found is Abort.DEVICE_STATE, f"another table is taken: {found}")


def _read_service(data: bytes | None) -> ServiceMessage | None:
    message = None if data is None else decode_service(Frame(_ANSWERS, data))
    return None if isinstance(message, Malformed) else message


def _demand(holds: bool, story: str) -> None:
    if not holds:
        raise WrongAnswerError(story)
