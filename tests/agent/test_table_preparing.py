"""A node prepares for a table beside the one that flies: numbers of modules, devices, files."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import pytest

from agent.one_pe import CONTROL, MONITOR, SERVO_1, TABLE
from agent.recorded_devices import RecordedDevice, RecordedDriver
from agent.test_table_change import EXTRA, OTHER
from heronry_agent.core.carried_over import read_beside
from heronry_agent.core.vocabulary import (
    AtRest,
    EndPartition,
    ImagesMissing,
    PartitionEnded,
    PrepareTable,
    StartModule,
    StepModule,
    Stepped,
    StopModule,
    TablePrepared,
)
from heronry_agent.shell.devices import DeviceDriverError, Devices
from heronry_agent.shell.module_numbers import ModuleNumbers
from heronry_agent.shell.node_devices import NodeDevices
from heronry_agent.shell.table_preparing import TablePreparing
from heronry_wire.pe_table import DeviceEntry, DriverEntry, ModuleEntry, PeTable

TEXT = OTHER.to_json().encode()
BESIDE = read_beside(TEXT, TABLE, 1)


def switched() -> ModuleNumbers:
    numbers = ModuleNumbers(TABLE)
    of, _ = numbers.of(BESIDE)
    numbers.put_beside(BESIDE, of)
    numbers.switch(BESIDE)
    return numbers


def test_a_module_keeps_its_number_in_its_process_and_a_new_one_has_a_number_of_its_own() -> None:
    numbers = ModuleNumbers(TABLE)
    of, added = numbers.of(BESIDE)
    assert {of[CONTROL + 1], of[SERVO_1 + 1]} == {CONTROL, SERVO_1}
    assert {module.name: module.index for module in added} == {"extra": 5, "monitor": 6}
    assert [module.index for module in numbers.of(BESIDE)[1]] == [7, 8]  # never the same numbers again


def test_actions_and_events_are_translated_once_the_tables_have_changed_places() -> None:
    first, numbers = ModuleNumbers(TABLE), switched()
    step = StepModule(CONTROL + 1, 9, {}, 0)
    assert first.inward(step) is step
    assert numbers.inward(step).module == CONTROL  # type: ignore[union-attr]
    start = numbers.inward(StartModule(EXTRA, BESIDE.modules[0], 0))
    assert isinstance(start, StartModule)
    assert (start.module, start.entry.index) == (5, 5)
    assert numbers.inward(StopModule(MONITOR + 1)) == StopModule(6)
    assert numbers.inward(EndPartition("A")) == EndPartition("A")
    event = Stepped(CONTROL, 9, {})
    assert first.outward(event) is event
    assert numbers.outward(event) == event._replace(module=CONTROL + 1)
    assert numbers.outward(AtRest(SERVO_1)) == AtRest(SERVO_1 + 1)
    assert numbers.outward(AtRest(MONITOR)) is None  # that one was stopped
    assert numbers.outward(event._replace(module=MONITOR)) is None
    assert numbers.outward(PartitionEnded("A", "", CONTROL)) == PartitionEnded("A", "", CONTROL + 1)
    assert numbers.outward(PartitionEnded("A", "", MONITOR)) == PartitionEnded("A", "", -1)
    assert numbers.outward(PartitionEnded("A", "", None)) == PartitionEnded("A", "", None)
    assert numbers.outward(ImagesMissing({})) == ImagesMissing({})
    assert numbers.indices(frozenset({CONTROL, 5, MONITOR})) == {CONTROL + 1, EXTRA}
    assert numbers.indices(frozenset({CONTROL, MONITOR}), beside=True) == {CONTROL, MONITOR}
    assert numbers.index(SERVO_1) == SERVO_1 + 1


def answer(preparing: TablePreparing) -> TablePrepared:
    until = monotonic() + 10
    while monotonic() < until:
        for prepared in preparing.take():
            return prepared
    raise AssertionError("the table was not read")


def preparing(file: Path | None, *, refuses: str = "", kept: list[Collection[int]] | None = None) -> TablePreparing:
    def opens(table: PeTable, added: Collection[ModuleEntry]) -> frozenset[int]:
        if refuses and refuses in table.spec:
            raise DeviceDriverError("device pump cannot be opened")
        return frozenset({SERVO_1, *(module.index for module in added if module.name == "extra")})

    told: list[str] = []
    why = {"extra": "not installed"}.get
    keep_only = ([] if kept is None else kept).append
    return TablePreparing(TABLE, file, open_added=opens, keep_only=keep_only, why_not_here=why, tell=told.append)


def test_the_file_of_a_node_has_the_table_that_flies(tmp_path: Path) -> None:
    file = tmp_path / "pe.table"
    file.write_text(TABLE.to_json())
    here = preparing(file)
    here.begin(PrepareTable(TEXT, 1), TABLE)
    prepared = answer(here)
    assert prepared.table == BESIDE
    assert prepared.missing == {"extra": "not installed"}
    assert prepared.slow_to_rest == {SERVO_1 + 1, EXTRA}
    assert file.read_text() == TABLE.to_json()
    here.begin(PrepareTable(TEXT, 2), TABLE)  # the same once more
    sleep(0.3)
    assert not list(here.take())
    here.switched(prepared.table)
    assert file.read_bytes() == TEXT
    here.switched(TABLE)
    assert file.read_text() == TABLE.to_json()
    assert {path.name for path in tmp_path.iterdir()} == {"pe.table", "pe.table.beside"}


def test_a_table_that_cannot_be_flown_or_kept_is_told_and_leaves_all_as_it_was(tmp_path: Path) -> None:
    here = preparing(None)
    for text in (b"\xff", b"{", TABLE.to_json().encode().replace(b"tail", b"nose")):
        here.begin(PrepareTable(text, 1), TABLE)
        assert answer(here).problem
    here.begin(PrepareTable(TEXT, 1), TABLE)
    here.switched(answer(here).table or TABLE)  # a node without a file
    refusing = preparing(None, refuses="other")
    refusing.begin(PrepareTable(TEXT, 1), TABLE)
    assert answer(refusing).problem == "device pump cannot be opened"
    lost = preparing(tmp_path / "no_such_folder" / "pe.table")
    lost.begin(PrepareTable(TEXT, 1), TABLE)
    assert "has no room beside it" in (answer(lost).problem or "")


def test_a_file_that_cannot_be_changed_is_told(tmp_path: Path) -> None:
    file, told = tmp_path / "pe.table", list[str]()
    file.write_text("")
    here = preparing(file)
    here._tell = told.append
    here.begin(PrepareTable(TEXT, 1), TABLE)
    prepared = answer(here)
    (tmp_path / "pe.table.beside").unlink()
    here.switched(prepared.table or TABLE)
    assert "cannot be changed" in told[0]


def test_the_second_file_is_that_of_the_table_beside_whatever_comes_after_it(tmp_path: Path) -> None:
    file = tmp_path / "pe.table"
    file.write_text(TABLE.to_json())
    here = preparing(file, refuses="unflyable")
    here._read_one(PrepareTable(TEXT, 1), TABLE)
    (prepared,) = here.take()
    unflyable = replace(OTHER, spec="unflyable", spec_digest="33" * 32).to_json().encode()
    for number, text in enumerate((TABLE.to_json().encode(), unflyable, b"{"), 2):
        here._read_one(PrepareTable(text, number), TABLE)
    assert [one.problem is None for one in here.take()] == [False, False]
    here.switched(prepared.table or TABLE)
    assert file.read_bytes() == TEXT
    here._read_one(PrepareTable(TEXT.replace(b"monitor", b"watcher"), 5), BESIDE)
    assert "damaged" in (next(here.take()).problem or "")
    here._read_one(PrepareTable(replace(OTHER, spec_digest="44" * 32).to_json().encode(), 6), BESIDE)
    (tmp_path / "pe.table.coming-6").unlink()
    assert "cannot have it beside it" in (next(here.take()).problem or "")
    assert {path.name for path in tmp_path.iterdir()} == {"pe.table", "pe.table.beside"}


def test_only_the_modules_of_the_two_tables_are_kept() -> None:
    kept: list[Collection[int]] = []
    here = preparing(None, kept=kept)
    first = {module.index for module in TABLE.modules}
    for number, digest in enumerate(("11", "22", "33"), 1):
        table = replace(OTHER, spec_digest=digest * 32)
        here._read_one(PrepareTable(table.to_json().encode(), number), TABLE)
        (prepared,) = here.take()
    assert kept == [first | {5, 6}, first | {7, 8}, first | {9, 10}]  # `extra` and the faster `monitor`
    here.switched(prepared.table or TABLE)
    assert here.numbers.in_use == kept[-1]


def test_devices_of_new_modules_are_opened_and_one_with_another_driver_is_refused() -> None:
    device = RecordedDevice()
    devices = Devices(TABLE, dict.fromkeys(("left", "right"), RecordedDriver(left=device, right=device)))
    pump = RecordedDevice()
    module = replace(TABLE.modules[1], index=9, name="pump", device="pump")
    table = replace(TABLE, devices=(*TABLE.devices, DeviceEntry("pump", "actuator", TABLE.node_id)))
    devices.add(table, [module], {"pump": RecordedDriver(pump=pump)})
    devices.make_safe(9, 0)
    assert pump.made_safe == 1
    assert devices.read(CONTROL, 0) is None


def test_a_node_opens_what_another_table_adds_and_keeps_what_it_has() -> None:
    node = NodeDevices(TABLE, {}, "plant", 0, {}, lambda _: None)
    module = replace(TABLE.modules[1], index=9, name="pump", device="rudder")
    table = replace(TABLE, modules=(*TABLE.modules, module), module_names=(*TABLE.module_names, *"abcd", "pump"))
    assert node.add(table, [module]) == frozenset()
    changed = replace(table, drivers=(DriverEntry("left", None, "{}", 5_000_000, None, None, None, None),))
    with pytest.raises(DeviceDriverError, match="the driver of device left is another one"):
        node.add(changed, [])
