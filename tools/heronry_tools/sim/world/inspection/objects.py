"""The topic of the inspection that reads and writes the object dictionary.

It covers constants, changing values, long texts, and objects that must not be written.
"""

from collections.abc import Callable, Mapping

from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.inspection.topic import SHORT_MS, Heard, Topic, demand
from heronry_tools.sim.world.sdo_talk import Talk
from heronry_wire.canopen_objects import (
    COUNTERS,
    DEVICE_NAME,
    ERROR_HISTORY,
    ERROR_REGISTER,
    HEARTBEAT_TIME,
    MASTERSHIP,
    MODULE_IMAGES,
    MODULE_INDICES,
    MODULE_MODES,
    MODULE_NAMES,
    MODULE_STATES,
    OBJECTS,
    PROGRAM_CONTROL,
    PROGRAM_DATA,
    SPEC,
    STATE,
    STORED_EDS,
    TABLE,
    Access,
    Entry,
    Kind,
)
from heronry_wire.eds import eds_text
from heronry_wire.pe_table import PeTable
from heronry_wire.sdo import DOWNLOAD, SIZE_GIVEN, Abort, with_number

_MODULE_ARRAYS = (MODULE_NAMES, MODULE_INDICES, MODULE_IMAGES, MODULE_STATES, MODULE_MODES)
_RUNNING, _NOT_WANTED = 1, 0


class Objects(Topic):
    """Reads and writes objects of the PE's object dictionary, and verifies the answers."""

    def __init__(self, clock: Clock, table: PeTable, heard: Heard, running: Callable[[], Mapping[str, str]]) -> None:
        """Prepare the inspection of the object dictionary of one PE.

        heard: the frames of the PE and of its manager that were heard so far
        running: returns the modules that are planned on the PE, with their modes
        """
        super().__init__(clock, table, heard)
        self._running = running

    def constants(self) -> Talk[None]:
        """Demand that the fixed properties of the object dictionary are right.

        These are the value of each constant, the length of each variable, and the objects that can only be written.
        Objects and sub-indices that are not in the dictionary must not exist.
        """
        for entry in OBJECTS:
            last = entry.most if entry.kind is Kind.ARRAY else len(entry.variables)
            every = (0,) if entry.kind in (Kind.VAR, Kind.DOMAIN) else range(last + 2)
            for sub_index in (0, 1, last + 1) if entry.kind is Kind.ARRAY else every:
                yield from self._constant(entry, sub_index)
        yield from self.read(DEVICE_NAME, 1, Abort.NO_SUB_INDEX)
        yield from self.read(0x5000, 0, Abort.NO_OBJECT)
        yield from self.read(PROGRAM_CONTROL, 1, 1)
        yield from self.read(SPEC, 1, self._table.name.encode())
        yield from self.read(SPEC, 2, self._table.spec.encode())
        yield from self.read(SPEC, 3, self._table.spec_digest.encode())

    def _constant(self, entry: Entry, sub_index: int) -> Talk[None]:
        variable = entry.variable(sub_index)
        if variable is None:
            yield from self.read(entry.index, sub_index, Abort.NO_SUB_INDEX)
        elif variable.access is Access.WRITE:
            yield from self.read(entry.index, sub_index, Abort.WRITE_ONLY)
        elif isinstance(variable.value, str):
            yield from self.read(entry.index, sub_index, variable.value.encode())
        elif variable.value is not None and variable.access in (Access.CONST, Access.READ):
            yield from self.read(entry.index, sub_index, variable.value + self._node * variable.of_node)
        elif variable.type.length is not None and entry.kind is not Kind.ARRAY:
            found = yield from self._sdo.upload(entry.index, sub_index)
            fits = isinstance(found, bytes) and len(found) == variable.type.length
            demand(fits, f"object {entry.index:04X}h, {sub_index} is {found!r}")

    def present_state(self, *, is_flying: bool) -> Talk[None]:
        """Demand that objects with changing values agree with the PE's state frames, the LEASE and the plan.

        is_flying: the PE runs a configuration, and hears a manager; False: it runs nothing, and hears none.
        """
        page, staged = self._heard.pages_0[-1][1], self._heard.pages_1[-1][1]
        told = (
            *(page.state, page.flags, page.incarnation, page.epoch, page.digest, None, staged.staged_epoch),
            *(staged.staged_digest, staged.reason.value, staged.load),
        )
        for sub_index, value in enumerate(told, start=1):
            if value is not None:
                yield from self.read(STATE, sub_index, int(value))
        manager, lease = self._heard.lease or (0, None)
        for sub_index, value in enumerate((manager, 0 if lease is None else lease.term), start=1):
            if manager and is_flying:
                yield from self.read(MASTERSHIP, sub_index, value)
        yield from self.read(MASTERSHIP, 3, int(is_flying))
        modules, running = self._table.modules, self._running() if is_flying else {}
        for position, module in enumerate(modules, start=1):
            mode = running.get(module.name)
            yield from self.read(MODULE_NAMES, position, module.name.encode())
            yield from self.read(MODULE_INDICES, position, module.index)
            yield from self.read(MODULE_IMAGES, position, module.image.encode())
            yield from self.read(MODULE_STATES, position, _NOT_WANTED if mode is None else _RUNNING)
            yield from self.read(MODULE_MODES, position, b"" if mode is None else mode.encode())
        for array in _MODULE_ARRAYS:
            yield from self.read(array, 0, len(modules))
            yield from self.read(array, len(modules) + 1, Abort.NO_DATA)
        yield from self.read(ERROR_REGISTER, 0, 0)
        yield from self.read(ERROR_HISTORY, 0, 0)
        yield from self.read(ERROR_HISTORY, 1, Abort.NO_DATA)
        yield from self.read(COUNTERS, 2, 0)

    def long_texts(self) -> Talk[None]:
        """Demand that long texts can be read by segments and by blocks, even if segments are lost."""
        sdo, eds, table = self._sdo, eds_text().encode(), self._table.to_json().encode()
        yield from self.read(STORED_EDS, 0, eds)
        for size, lost in ((127, 0), (16, 3), (1, 0)):
            found = yield from sdo.upload_by_block(TABLE, 0, size, lost)
            demand(found == table, f"its table read by blocks of {size} differs from its table")
        found = yield from sdo.upload_by_block(DEVICE_NAME, 0, 5)
        demand(found == b"heronry PE", f"its name read by block is {found!r}")
        for size in (0, 128):
            found = yield from sdo.upload_by_block(TABLE, 0, size)
            demand(found is Abort.BLOCK_SIZE, f"a block size of {size} segments is accepted")
        found = yield from sdo.upload_by_block(0x5000, 0, 5)
        demand(found is Abort.NO_OBJECT, "object 5000h exists")

    def refusals(self, *, is_flying: bool) -> Talk[None]:
        """Demand the right abort code for forbidden writes, and for writes with a wrong length or value.

        Also demand that the error history can be emptied.

        is_flying: False: a transfer that is too large for the table must be refused, too.
        """
        wrong: tuple[tuple[int, int, bytes, Abort], ...] = (
            (DEVICE_NAME, 0, b"mine", Abort.READ_ONLY),
            (STATE, 1, b"\1", Abort.READ_ONLY),
            (PROGRAM_CONTROL, 1, b"\0", Abort.UNSUPPORTED),
            (PROGRAM_DATA, 1, bytes(20), Abort.UNSUPPORTED),
            (0x5000, 0, b"\1", Abort.NO_OBJECT),
            (STATE, 11, b"\1", Abort.NO_SUB_INDEX),
            (HEARTBEAT_TIME, 0, b"\1", Abort.LENGTH),
            (HEARTBEAT_TIME, 0, (SHORT_MS - 1).to_bytes(2, "little"), Abort.VALUE),
            (ERROR_HISTORY, 0, b"\1", Abort.VALUE),
        )
        for index, sub_index, data, reason in wrong:
            found = yield from self._sdo.download(index, sub_index, data)
            demand(found is reason, f"writing to {index:04X}h, {sub_index} is answered with {found}")
        # A PE that flies reads what has come only afterwards; with a key it refuses at once what has no seal.
        right = (None, Abort.VALUE) if is_flying else (Abort.VALUE,)
        for found in (
            (yield from self._sdo.download(TABLE, 0, b"no table")),
            (yield from self._sdo.download_by_block(TABLE, 0, b"no table")),
        ):
            demand(found in right, f"writing what is no table to 2020h is answered with {found}")
        found = yield from self._sdo.download(ERROR_HISTORY, 0, b"\0")
        demand(found is None, f"the error history is not emptied: {found}")
        if not is_flying:
            huge = with_number(DOWNLOAD | SIZE_GIVEN, TABLE, 0, (1 << 20) + 1)
            yield from self._sdo.refused(huge, Abort.OUT_OF_MEMORY, TABLE)

    def own_table(self) -> Talk[None]:
        """Demand that the PE accepts its own table by every kind of transfer, and refuses what is no table."""
        own, sdo = self._table.to_json().encode(), self._sdo
        for written in (own, b" " + own + b"\n"):
            found = yield from sdo.download(TABLE, 0, written)
            demand(found is None, f"its own table is refused: {found}")
        found = yield from sdo.download_by_block(TABLE, 0, own, loses=3)
        demand(found is None, f"its own table is refused by blocks: {found}")
        found = yield from sdo.download_by_block(TABLE, 0, own, checksum=1)
        demand(found is Abort.CRC, f"a wrong checksum is answered with {found}")
        found = yield from sdo.download_by_block(TABLE, 0, b"no table")
        demand(found is Abort.VALUE, f"what is no table is answered with {found}")
