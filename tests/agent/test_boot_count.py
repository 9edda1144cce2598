"""The boot count: new at each beginning, with a disk that works, is full or slow, or has something else there."""

import os
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from time import sleep

import pytest

from heronry_agent.shell import incarnation
from heronry_agent.shell.incarnation import RESERVE, BootCount

NODE = 93


class Starts:
    """Processes of one PE, one after the other, with what they say."""

    def __init__(self, folder: Path | None) -> None:
        self.folder, self.said = folder, list[str]()
        self.file = Path() if folder is None else folder / f"pe-{NODE}.incarnation"
        self._counts: list[BootCount] = []

    def start(self) -> BootCount:
        self._counts.append(BootCount(self.folder, NODE, self.said.append))
        return self._counts[-1]

    def close(self) -> None:
        for one in self._counts:
            one.close()


@pytest.fixture
def starts(tmp_path: Path) -> Iterator[Starts]:
    all_of_them = Starts(tmp_path / "state")
    yield all_of_them
    all_of_them.close()


@contextmanager
def full_disk() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def until(holds: Callable[[], object]) -> None:
    for _ in range(1000):
        if holds():
            return
        sleep(0.01)
    raise AssertionError("it never holds")


def test_no_count_comes_twice_in_the_last_hundred(starts: Starts) -> None:
    given: list[int] = []
    for _ in range(6):
        process = starts.start()
        given += [process.next() for _ in range(3)]
    assert len(set(given)) == len(given)
    assert all(0 <= count <= 255 for count in given)
    assert starts.said == []


def test_a_count_wraps(starts: Starts) -> None:
    starts.start().next()
    starts.file.write_text("255\n")
    process = starts.start()
    assert (process.next(), process.next()) == (0, 1)


def test_the_reserve_on_the_disk_is_ahead_of_all_counts_given(starts: Starts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(incarnation, "LONGEST_START_S", 60.0)  # a busy disk may take more than two seconds
    process = starts.start()
    for _ in range(3 * RESERVE):
        count = process.next()
        until(lambda count=count: 0 <= (int(starts.file.read_text()) - count) % 256 <= RESERVE)
    assert starts.start().next() not in range(count - RESERVE, count + 1)


@pytest.mark.parametrize("content", [b"", b"nonsense", b"-4", "²".encode(), b"\xff", b"1" * 5000])
def test_a_count_that_is_no_number_is_drawn_anew(starts: Starts, content: bytes) -> None:
    starts.file.parent.mkdir()
    starts.file.write_bytes(content)
    assert 0 <= starts.start().next() <= 255
    assert 0 <= int(starts.file.read_text()) <= 255


def test_without_a_folder_it_is_drawn_at_random() -> None:
    process = Starts(None).start()
    first = process.next()
    assert process.next() == (first + 1) % 256


def test_a_disk_that_is_full_in_flight_grounds_nobody_and_no_count_comes_twice(
    starts: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(incarnation, "RETRY_S", 0.02)
    process = starts.start()
    given = [process.next()]
    with full_disk():
        given += [process.next() for _ in range(2 * RESERVE)]
        until(lambda: starts.said)
        assert "File too large; the agent continues and tries again" in starts.said[0]
    until(lambda: len(starts.said) == 2)
    assert "the boot count is kept again" in starts.said[1]
    given.append(starts.start().next())
    assert len(set(given)) == len(given)
    assert [file.name for file in starts.file.parent.iterdir()] == [starts.file.name], "no draft is left behind"


def test_a_disk_that_is_full_at_the_start_grounds_nobody(starts: Starts, monkeypatch: pytest.MonkeyPatch) -> None:
    starts.start().next()
    on_disk = int(starts.file.read_text())
    monkeypatch.setattr(incarnation, "RETRY_S", 0.02)
    with full_disk():
        given = {starts.start().next() for _ in range(20)}
    assert (on_disk + 1) % 256 not in given, "each of them would have begun with this one"
    assert len(given) > 10
    assert "until then a restart may not be recognized" in starts.said[0]


@pytest.mark.parametrize("made", ["pipe", "folder", "pipe as draft", "file as folder"])
def test_something_else_in_its_place_neither_hangs_nor_ends_the_agent(starts: Starts, made: str) -> None:
    if made == "file as folder":
        starts.file.parent.write_text("")
    else:
        starts.file.parent.mkdir()
        place = starts.file.with_name(f"{starts.file.name}.new") if "draft" in made else starts.file
        place.mkdir() if made == "folder" else os.mkfifo(place)
    process = starts.start()
    first = process.next()
    assert process.next() == (first + 1) % 256
    assert len(starts.said) == 1
    assert "the agent continues" in starts.said[0]


def test_a_slow_disk_holds_up_the_start_for_a_while_and_the_flight_never(
    starts: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_on_disk, fsync = Event(), os.fsync

    def slow(descriptor: int) -> None:
        is_on_disk.wait()
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", slow)
    monkeypatch.setattr(incarnation, "LONGEST_START_S", 0.01)
    process = starts.start()
    given = [process.next() for _ in range(RESERVE)]
    assert "the disk takes longer than 0.01 s" in starts.said[0]
    is_on_disk.set()
    until(starts.file.exists)
    assert len(set(given)) == RESERVE
