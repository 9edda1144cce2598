"""The manager's journal after kills, changed bits and full disks: its content was true once, and numbers only rise.

The test knows the records that were written, in order, and not how the journal keeps them.
"""

import os
import resource
import signal
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from threading import Event
from time import sleep

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from heronry_dg.loader import loads
from heronry_manager.checked_lines import DAMAGED, checked_line, line_content
from heronry_manager.core.memory import (
    EPOCHS,
    NOTHING,
    Cleared,
    Latched,
    Memory,
    PhaseEntered,
    PhaseRequest,
    PriorityChanged,
    PriorityRequest,
    PriorityRestored,
    Quarantined,
    Record,
    Released,
    Reserved,
    Runs,
    SpecFlies,
    TermBegun,
    as_json,
    from_json,
    is_number,
)
from heronry_manager.shell.journal import RETRY_NS, Journal, JournalError, recovered, whole_journal, written
from manager.one_manager import SPEC_TEXT, two_tails
from thoroughness import part_of

SPEC = two_tails()
OTHER_SPEC = loads(SPEC_TEXT.replace("rate_hz: 40", "rate_hz: 20"), "two_tails.dg.yaml")
NODE = 126

STORY: tuple[Record, ...] = (
    TermBegun(1),
    Reserved(EPOCHS, 16),
    Runs(1, 0xABCDEF, "0102"),
    PhaseEntered("glide"),
    Latched("device:servo_left", "left", "REPORTED", 57),
    Latched("pe:right", "the operator", "OPERATOR", 0),
    Quarantined("middle", 2),
    Cleared("device:servo_left"),
    Reserved(EPOCHS, 48),
    Released("middle"),
    Reserved("counter", 4096),
    TermBegun(3),
    Runs(17, 1, "03"),
    SpecFlies(0x3F2A),
)
MEMORIES = tuple(accumulate(STORY, Memory.after, initial=NOTHING))
HEAD = whole_journal(SPEC, NOTHING)
DATA = HEAD + b"".join(written(number, as_json(record)) for number, record in enumerate(STORY, start=1))

_names = st.text(max_size=8)
_small = st.integers(0, 0xFFFFFF)
records = st.lists(
    st.one_of(
        st.integers(1, 4095).map(TermBegun),
        st.builds(Reserved, st.sampled_from((EPOCHS, "counter")), _small),
        st.builds(Runs, st.integers(1, 0xFFFF), _small, _names),
        st.integers(0, 0xFFFF).map(SpecFlies),
        _names.map(PhaseEntered),
        st.builds(Latched, _names, _names, _names, _small),
        _names.map(Cleared),
        st.builds(Quarantined, _names, _small),
        _names.map(Released),
        st.builds(PhaseRequest, _names, _small, _small),
        st.builds(PriorityChanged, _names, _small, st.booleans()),
        _names.map(PriorityRestored),
        st.builds(PriorityRequest, _names, _small, _names, _small),
    ),
    max_size=12,
)


def facts(memory: Memory) -> Memory:
    told = Memory(0, {}, memory.runs, memory.phase, memory.latched, memory.quarantined)
    return replace(told, flies=memory.flies)


# What is read


@given(records)
@example([PhaseRequest("left", 1, 2), PriorityChanged("f", 9, by_operator=True), PriorityRequest("left", 1, "f", 2)])
@example([PriorityChanged("f", 9, by_operator=False), PriorityRestored("f"), *STORY])
def test_a_journal_gives_back_what_was_put_into_it(story: list[Record]) -> None:
    memory = NOTHING
    for record in story:
        assert from_json(as_json(record)) == record
        memory = memory.after(record)
    assert recovered(whole_journal(SPEC, memory)) == (memory, SPEC.digest)


def test_cut_off_at_any_byte_it_holds_all_that_was_written_before_and_at_most_one_record_more() -> None:
    ends = list(accumulate((len(written(n, as_json(r))) for n, r in enumerate(STORY, 1)), initial=len(HEAD)))
    for length in range(len(HEAD), len(DATA) + 1):
        whole = sum(end <= length for end in ends) - 1
        memory, digest = recovered(DATA[:length])
        assert digest == SPEC.digest
        assert memory in MEMORIES[whole : whole + 2]


def test_any_single_bit_that_has_changed_costs_nothing() -> None:
    kept = STORY[3:8]
    data = HEAD + b"".join(written(number, as_json(record)) for number, record in enumerate(kept, start=1))
    undamaged = recovered(data)
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        assert recovered(bytes(changed)) == undamaged


@given(st.data())
@settings(max_examples=part_of(300))
def test_whatever_is_damaged_the_facts_were_true_once_and_no_number_is_new(data: st.DataObject) -> None:
    changed = bytearray(DATA)
    for _ in range(data.draw(st.integers(1, 6))):
        start = data.draw(st.integers(0, len(changed)))
        end = min(len(changed), start + data.draw(st.integers(0, 200)))
        changed[start:end] = data.draw(st.binary(max_size=20))
    memory, digest = recovered(bytes(changed))
    assert facts(memory) in [facts(one) for one in MEMORIES]
    assert memory.term in {one.term for one in MEMORIES}
    assert memory.reserved.get(EPOCHS, 0) in {one.reserved.get(EPOCHS, 0) for one in MEMORIES}
    assert digest in (SPEC.digest, None)


def test_numbers_behind_a_hole_count_and_facts_behind_it_do_not() -> None:
    pieces = [written(number, as_json(record)) for number, record in enumerate(STORY, start=1)]
    del pieces[3]
    memory, _ = recovered(HEAD + b"".join(pieces))
    assert (memory.term, memory.reserved) == (3, {EPOCHS: 48, "counter": 4096})
    assert facts(memory) == facts(MEMORIES[3])


def test_what_a_hole_has_cost_is_told_at_the_next_start(tmp_path: Path) -> None:
    file = tmp_path / "manager-126.journal"
    pieces = [written(number, as_json(record)) for number, record in enumerate(STORY, start=1)]
    lost = [record for record in STORY[4:] if not is_number(record)]
    file.write_bytes(HEAD + b"".join(pieces[:3] + pieces[4:]))
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert f"is damaged: {1 + len(lost)} of its records cannot be used" in (journal.warning or "")
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert journal.warning is None
    file.write_bytes(HEAD + b"".join(pieces[:-1]) + pieces[-1][:20])
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert journal.warning is None  # killed while it wrote its last record


@given(st.binary())
def test_bytes_of_any_kind_are_read_without_an_error(data: bytes) -> None:
    assert recovered(data) == (NOTHING, None)
    assert line_content(data) is DAMAGED or checked_line(line_content(data)) == data


def test_a_whole_line_that_is_no_record_is_ignored() -> None:
    strange = (["term", 0], ["term", 4096], ["runs", 0, 1, ""], ["new in a later version"], "text", [])
    assert [from_json(content) for content in strange] == [None] * len(strange)
    line = checked_line([1, "new in a later version"])
    assert recovered(HEAD + line + written(2, as_json(TermBegun(7))))[0].term == 7
    assert line_content(b"00000000 {\n") is DAMAGED


def test_a_line_that_is_whole_and_no_json_is_damaged() -> None:
    text = b"[" * 100_000
    assert line_content(b"%08x %s\n" % (zlib.crc32(text), text)) is DAMAGED


# What is written


_KILLED_IN = 9  # records, some of each kind


def _die_at_call(at_call: int, share: float) -> None:
    """Let this process die at the n-th call that touches the disk; a write at which it dies has written a part."""
    real_write, real_fsync, real_replace = os.write, os.fsync, Path.replace
    left = at_call

    def is_hit() -> bool:
        nonlocal left
        left -= 1
        return left == 0

    def write(descriptor: int, data: memoryview) -> int:
        if is_hit():
            real_write(descriptor, data[: int(share * len(data))])
            os.kill(os.getpid(), signal.SIGKILL)
        return real_write(descriptor, data[:150])  # the kernel may take less than it is given

    def fsync(descriptor: int) -> None:
        if is_hit():
            os.kill(os.getpid(), signal.SIGKILL)
        real_fsync(descriptor)

    def replace(draft: Path, file: Path) -> Path:
        if is_hit():
            os.kill(os.getpid(), signal.SIGKILL)
        return real_replace(draft, file)

    os.write, os.fsync = write, fsync  # type: ignore[assignment]
    Path.replace = replace  # type: ignore[assignment, method-assign]


def _written_by_a_child(folder: Path, at_call: int, share: float) -> tuple[int, bool]:
    """How many records a process has written that dies at its n-th call, and whether it reached its end."""
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        count = os.write
        _die_at_call(at_call, share)
        journal = Journal(folder, NODE, SPEC)
        for record in STORY[:_KILLED_IN]:
            journal.write(record)
            count(tell, b".")
        os._exit(0)
    os.close(tell)
    with os.fdopen(told, "rb") as stream:
        done = len(stream.read())
    return done, os.waitpid(child, 0)[1] == 0


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_killed_at_every_point_at_which_it_writes_it_is_taken_up_where_it_was(tmp_path: Path, share: float) -> None:
    for point in range(1, 1000):
        folder = tmp_path / str(point)
        done, is_over = _written_by_a_child(folder, point, share)
        with Journal(folder, NODE, SPEC) as journal:
            assert journal.memory in MEMORIES[done : done + 2]
        if is_over:
            break
    assert is_over
    assert point > _KILLED_IN


def test_the_next_manager_takes_the_journal_up_and_shortens_it(tmp_path: Path) -> None:
    with Journal(tmp_path, NODE, SPEC) as journal:
        for record in STORY:
            journal.write(record)
        assert journal.problem is None
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert journal.memory == MEMORIES[-1]
        assert journal.file.read_bytes() == whole_journal(SPEC, MEMORIES[-1])
        journal.write(PhaseEntered("land"))
        assert recovered(journal.file.read_bytes())[0] == journal.memory


def test_a_journal_that_has_grown_long_is_shortened(tmp_path: Path) -> None:
    with Journal(tmp_path, NODE, SPEC) as journal:
        sizes = []
        for number in range(300):
            journal.write(PhaseEntered(f"{number:0200}"))
            sizes.append(journal.file.stat().st_size)
        assert sizes != sorted(sizes)
        assert recovered(journal.file.read_bytes())[0].phase == f"{299:0200}"


def test_two_managers_keep_two_journals_and_none_keeps_one_with_another(tmp_path: Path) -> None:
    kept = pytest.raises(JournalError, match="another manager writes")
    with Journal(tmp_path, 126, SPEC), Journal(tmp_path, 127, SPEC), kept:
        Journal(tmp_path, 126, SPEC)
    Journal(tmp_path, 126, SPEC).close()


# A spec that has changed, files that are no journals, disks that do not work


def test_a_spec_that_has_changed_is_refused_until_told_otherwise(tmp_path: Path) -> None:
    with Journal(tmp_path, NODE, SPEC) as journal:
        for record in STORY:
            journal.write(record)
    with pytest.raises(JournalError, match="--changed-spec"):
        Journal(tmp_path, NODE, OTHER_SPEC)
    with Journal(tmp_path, NODE, OTHER_SPEC, accept_changed_spec=True) as journal:
        assert journal.memory == Memory(3, {EPOCHS: 48, "counter": 4096})
    with pytest.raises(JournalError, match="--changed-spec"):
        Journal(tmp_path, NODE, SPEC)


@pytest.mark.parametrize("data", [b"\n", b"3\n", DATA[: len(HEAD) // 4]])
def test_what_is_no_journal_is_left_alone(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "manager-126.journal"
    file.write_bytes(data)
    with pytest.raises(JournalError, match="is no manager's journal; remove the file"):
        Journal(tmp_path, NODE, SPEC)
    assert file.read_bytes() == data


def test_without_its_head_a_journal_still_gives_the_numbers(tmp_path: Path) -> None:
    (tmp_path / "manager-126.journal").write_bytes(DATA[len(HEAD) :])
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert journal.memory == MEMORIES[-1].numbers()


def test_a_journal_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "manager-126.journal").mkdir()
    with pytest.raises(JournalError, match="name another folder with --state-dir"):
        Journal(tmp_path, NODE, SPEC)


@contextmanager
def full_disk(bytes_left: int = 0) -> Iterator[None]:
    """No file of this process may grow beyond this (bytes)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_stops_no_manager_and_once_there_is_room_again_all_of_it_is_kept(tmp_path: Path) -> None:
    with Journal(tmp_path, NODE, SPEC) as journal:
        for number, record in enumerate(STORY):
            room = len(HEAD) + 40 * number if number in (3, 4, 8) else resource.RLIM_INFINITY
            with full_disk(room):
                journal.write(record)
                assert (journal.problem is None) is (room == resource.RLIM_INFINITY)
                journal.sync(0)
                assert journal.memory == MEMORIES[number + 1]
            held, _ = recovered(journal.file.read_bytes())
            assert held in MEMORIES
            assert journal.problem is not None or held == journal.memory


def test_a_journal_that_cannot_be_kept_from_the_start_says_so_and_remembers_its_records() -> None:
    with Journal(Path("/proc/nowhere"), NODE, SPEC) as journal:
        assert "/proc/nowhere/manager-126.journal" in (journal.problem or "")
        journal.write(TermBegun(1))
        assert journal.memory.term == 1
        assert journal.problem is not None


def test_a_disk_that_fails_to_keep_what_it_has_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: int) -> None:
        raise OSError(5, "Input/output error")

    with Journal(tmp_path, NODE, SPEC) as journal:
        journal.write(PhaseEntered("land"))
        monkeypatch.setattr(os, "fsync", fails)
        sync_until(journal, lambda: journal.problem is not None)
        assert "Input/output error" in (journal.problem or "")
        journal.sync(0)
        monkeypatch.undo()
        journal.sync(RETRY_NS - 1)
        assert journal.problem is not None
        journal.sync(RETRY_NS)
        assert journal.problem is None, "the journal is written anew without waiting for a record"


def sync_until(journal: Journal, holds: Callable[[], bool]) -> None:
    """Turn as the driver does, until something holds."""
    for _ in range(1000):
        journal.sync(0)
        if holds():
            return
        sleep(0.01)
    raise AssertionError("it never holds")


def test_a_slow_disk_holds_nothing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    is_on_disk, fsync = Event(), os.fsync

    def slow(descriptor: int) -> None:
        is_on_disk.wait()
        fsync(descriptor)

    with Journal(tmp_path, NODE, SPEC) as journal:
        journal.write(PhaseEntered("land"))
        monkeypatch.setattr(os, "fsync", slow)
        journal.sync(0)
        journal.write(PhaseEntered("glide"))
        journal.sync(0)
        is_on_disk.set()
        assert journal.problem is None


@pytest.mark.parametrize("name", ["manager-126.journal", "manager-126.new"])
def test_a_pipe_in_the_place_of_a_file_does_not_hang_the_manager(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    if name.endswith(".new"):
        with Journal(tmp_path, NODE, SPEC) as journal:
            assert journal.problem is not None
    else:
        with pytest.raises(JournalError, match="this is not an ordinary file; make it a file that you can read, or"):
            Journal(tmp_path, NODE, SPEC)


def test_a_folder_in_the_place_of_the_lock_is_named(tmp_path: Path) -> None:
    (tmp_path / "manager-126.lock").mkdir()
    with pytest.raises(JournalError, match=r"manager-126\.lock is a folder; remove it"):
        Journal(tmp_path, NODE, SPEC)


def test_an_empty_journal_is_begun_anew_and_that_is_told(tmp_path: Path) -> None:
    (tmp_path / "manager-126.journal").write_bytes(b"")
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert "was empty: earlier terms, orders and latched faults are not known" in (journal.warning or "")
        assert journal.memory == NOTHING
        journal.write(TermBegun(1))
    with Journal(tmp_path, NODE, SPEC) as journal:
        assert journal.warning is None
        assert journal.memory.term == 1


def test_a_journal_of_a_later_version_is_refused_and_left_alone(tmp_path: Path) -> None:
    data = written(0, ["journal", 2, SPEC.name, SPEC.digest]) + written(1, ["term", 7])
    file = tmp_path / "manager-126.journal"
    file.write_bytes(data)
    with pytest.raises(JournalError, match="has format 2, of a later version, and this version reads format 1"):
        Journal(tmp_path, NODE, SPEC)
    assert file.read_bytes() == data


def test_only_numbers_wait_for_the_disk() -> None:
    assert [type(record) for record in STORY if is_number(record)] == [
        TermBegun,
        Reserved,
        Reserved,
        Reserved,
        TermBegun,
    ]
