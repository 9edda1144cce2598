"""Control groups, on a kernel that counts memory in them: what RLIMIT_DATA does not see is limited and ended, too."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from agent.one_pe import CONTROL, MONITOR
from heronry_agent.core.vocabulary import Note, PartitionEnded
from heronry_agent.shell.partition_groups import PartitionGroups, open_groups
from live.test_partitions import PATIENCE_S, Hosted, _path

pytestmark = pytest.mark.vcan  # the user-mode Linux of tools/with-vcan has them
ROOT = Path("/sys/fs/cgroup")

__all__ = ["_path"]


@pytest.fixture(scope="module")
def hierarchy() -> Path:
    """The root of the groups, which counts memory in those below."""
    if os.geteuid() != 0:
        pytest.skip("making control groups needs root")
    if not (ROOT / "cgroup.controllers").exists():
        subprocess.run(["mount", "-t", "cgroup2", "none", str(ROOT)], check=True)
    if "memory" not in (ROOT / "cgroup.controllers").read_text():
        pytest.skip("version 1 counts memory here")
    (ROOT / "cgroup.subtree_control").write_text("+memory")
    return ROOT


class Delegated:
    """A group that this process is in."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self._enter(folder)

    @staticmethod
    def _enter(folder: Path) -> None:
        (folder / "cgroup.procs").write_text(str(os.getpid()))

    def mark(self) -> None:
        os.setxattr(self.folder, "user.delegate", b"1")

    def partitions(self) -> list[Path]:
        return list(self.folder.glob("partition.*"))

    def living(self) -> set[int]:
        """Processes of all partitions."""
        return {int(pid) for folder in self.partitions() for pid in (folder / "cgroup.procs").read_text().split()}

    def leave(self) -> None:
        self._enter(ROOT)
        for folder in [*self.folder.iterdir(), self.folder]:
            with suppress(NotADirectoryError):
                folder.rmdir()


@pytest.fixture
def delegated(hierarchy: Path) -> Iterator[Delegated]:
    group = Delegated(hierarchy / "heronry-test")
    try:
        yield group
    finally:
        group.leave()


@pytest.fixture
def groups(delegated: Delegated) -> PartitionGroups:
    delegated.mark()
    opened = open_groups(lambda note: pytest.fail(note.text))
    assert opened is not None
    return opened


def test_what_a_partition_shares_is_limited_and_others_go_on(delegated: Delegated, groups: PartitionGroups) -> None:
    hosted = Hosted("Shares", groups=groups)
    try:
        assert hosted.misbehave() == PartitionEnded("bad", "it took more memory than its limit", CONTROL)
        assert hosted.demand(MONITOR) == 3.0
        hosted.start(CONTROL)
        assert hosted.demand(CONTROL) == 1.0
        assert {folder.name for folder in delegated.partitions()} == {f"partition.{n}" for n in hosted.pids().values()}
    finally:
        hosted.host.close()
    assert delegated.partitions() == []


def test_what_a_partition_has_started_ends_with_it(delegated: Delegated, groups: PartitionGroups) -> None:
    hosted = Hosted("Multiplies", groups=groups)
    try:
        assert hosted.misbehave() == PartitionEnded("bad", "exit code 3", CONTROL)
        end_s = time.monotonic() + PATIENCE_S
        while delegated.living() != {hosted.pids()["good"]}:
            assert time.monotonic() < end_s
        hosted.start(CONTROL)
        assert len(delegated.partitions()) == len(("good", "bad"))
    finally:
        hosted.host.close()


def test_a_group_that_was_not_delegated_is_left_alone(delegated: Delegated) -> None:
    assert open_groups(lambda note: pytest.fail(note.text)) is None
    assert delegated.partitions() == []
    assert (delegated.folder / "cgroup.procs").read_text().split() == [str(os.getpid())]


def test_where_memory_is_not_counted_it_is_said(delegated: Delegated, hierarchy: Path) -> None:
    delegated.mark()
    (hierarchy / "cgroup.subtree_control").write_text("-memory")
    notes: list[Note] = []
    try:
        assert open_groups(notes.append) is None
    finally:
        (hierarchy / "cgroup.subtree_control").write_text("+memory")
    assert "cgroup_enable=memory" in notes[0].text
