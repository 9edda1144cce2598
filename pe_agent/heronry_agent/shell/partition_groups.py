"""The memory of a partition with all that it has started and shares: control groups (Linux, cgroup v2).

RLIMIT_DATA (`partition_process`) bounds each process by itself, and counts neither what is shared nor the children of
a module. The group of a partition counts everything, and ends everything. It is there where whoever started the agent
gave it a group of its own to divide, and said so by the attribute `user.delegate`, as systemd does for `Delegate=`;
nobody else's group is touched. Processes may be in leaves only (cgroups(7)), so the agent moves down first:

    heronry-agent@nav.service     delegated
        agent                     the agent
        partition.4711            a partition, by its process number, until nothing of it is left

A group is *unlimited* while its partition loads, then *limited*. A partition that goes beyond is killed by the kernel,
with all of its processes. Whatever fails here costs this second limit and nothing else.
"""
# ruff: noqa: PTH103, PTH106, PTH112, PTH123 - without pathlib, like all of the agent's own files

import os
from collections.abc import Callable
from contextlib import suppress

from heronry_agent.core.vocabulary import Note

_MARK = "user.delegate"
_AGENT = "agent"
_OWN_HIERARCHY = "0::"  # the line of /proc/self/cgroup that is about version 2
_NO_MEMORY = "the kernel counts no memory in control groups: add cgroup_enable=memory to its command line"


class PartitionGroup:
    """The group of one partition."""

    def __init__(self, folder: str) -> None:
        self._folder = folder

    def limit(self, more: int) -> None:
        """Let all of it take `more` bytes beyond what it holds now."""
        with suppress(OSError, ValueError):
            _write(self._folder, "memory.max", int(_read(self._folder, "memory.current")) + more)
            _write(self._folder, "memory.swap.max", 0)

    def kill(self) -> None:
        """Kill all that is in it."""
        with suppress(OSError):
            _write(self._folder, "cgroup.kill", 1)

    def ran_out(self) -> bool:
        """Tell whether the kernel has killed anything in it for want of memory."""
        with suppress(OSError):
            return "oom_kill 0" not in _read(self._folder, "memory.events").splitlines()
        return False

    def remove(self) -> bool:
        """Take the group away; tells whether it is gone."""
        with suppress(OSError):
            os.rmdir(self._folder)
        return not os.path.isdir(self._folder)


class PartitionGroups:
    """The delegated group, divided."""

    def __init__(self, folder: str) -> None:
        """Move this process into a leaf and have the kernel count memory below. Raises OSError."""
        self._folder = folder
        self._ended: list[PartitionGroup] = []
        _enter(f"{folder}/{_AGENT}", os.getpid())
        _write(folder, "cgroup.subtree_control", "+memory")

    def enclose(self, pid: int) -> PartitionGroup | None:
        """Put a process that has just begun into a group of its own; None where that cannot be."""
        self._ended = [group for group in self._ended if not group.remove()]
        folder = f"{self._folder}/partition.{pid}"
        try:
            _enter(folder, pid)
            _write(folder, "memory.oom.group", 1)
        except OSError:
            return None
        return PartitionGroup(folder)

    def retire(self, group: PartitionGroup) -> bool:
        """The partition of a group has ended; tells whether the kernel killed it for what it took."""
        ran_out = group.ran_out()
        if not group.remove():  # what it has started may take a moment longer
            self._ended.append(group)
        return ran_out


def open_groups(tell: Callable[[Note], None]) -> PartitionGroups | None:
    """Divide the group of this process, where it was delegated to it; tells why not, where that fails."""
    folder = _own_folder()
    if folder is None or not _is_delegated(folder):
        return None
    try:
        if "memory" in _read(folder, "cgroup.controllers").split():
            return PartitionGroups(folder)
        reason = _NO_MEMORY
    except OSError as error:
        reason = str(error)
    tell(Note("partitions", f"no control groups, RLIMIT_DATA alone limits them: {reason}"))
    return None


def _own_folder() -> str | None:
    """Where the group of this process is; None where there is no version 2."""
    try:
        with open("/proc/self/cgroup", encoding="utf-8") as groups:
            own = next(line[len(_OWN_HIERARCHY) :].rstrip("\n") for line in groups if line.startswith(_OWN_HIERARCHY))
        with open("/proc/self/mounts", encoding="utf-8") as mounts:
            return next(words[1] + own for words in map(str.split, mounts) if words[2] == "cgroup2")
    except (OSError, StopIteration):
        return None


def _is_delegated(folder: str) -> bool:
    try:
        return os.getxattr(folder, _MARK) == b"1"
    except OSError:
        return False


def _enter(folder: str, pid: int) -> None:
    os.makedirs(folder, exist_ok=True)
    _write(folder, "cgroup.procs", pid)


def _read(folder: str, name: str) -> str:
    with open(f"{folder}/{name}", encoding="ascii") as file:
        return file.read()


def _write(folder: str, name: str, content: object) -> None:
    with open(f"{folder}/{name}", "w", encoding="ascii") as file:
        file.write(str(content))
