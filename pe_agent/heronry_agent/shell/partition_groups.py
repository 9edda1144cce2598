"""Limits the memory of a partition, with its child processes and shared memory, by control groups (cgroup v2).

The other limit, RLIMIT_DATA (`partition_process`), applies to a single process: it counts neither shared
memory nor the child processes of a module. A control group counts both. It also allows the agent to end all
processes of a partition together.

Groups are used only if the agent was started in a group that the agent may divide. Systemd marks such a group
with the attribute `user.delegate` (`Delegate=` in the unit). All processes must be in the groups below a
divided group, and none in the divided group itself (cgroups(7)). So the agent first moves to a group below:

    heronry-agent@nav.service     the delegated group, which the agent divides
        agent                     the group of the agent
        partition.4711            the group of a partition, named by the partition's process number; it is
                                  there until all processes of the partition have ended

The group of a partition has no memory limit while the partition loads its code. Later it has one, and the
kernel kills all processes of a partition that exceeds the limit of its group. If control groups cannot be
used, only RLIMIT_DATA limits the partition.
"""
# ruff: noqa: PTH103, PTH106, PTH112, PTH123 - without pathlib, like all of the agent's own files

import os
from collections.abc import Callable
from contextlib import suppress

from heronry_agent.core.vocabulary import Note

_MARK = "user.delegate"
_AGENT = "agent"
_OWN_HIERARCHY = "0::"  # the line of /proc/self/cgroup for version 2
_NO_MEMORY = "the kernel counts no memory in control groups: add cgroup_enable=memory to the kernel's command line"


class PartitionGroup:
    """The control group of one partition."""

    def __init__(self, folder: str) -> None:
        self._folder = folder

    def limit(self, more: int) -> None:
        """Limit the memory of the group to what it uses now plus `more` bytes."""
        with suppress(OSError, ValueError):
            _write(self._folder, "memory.max", int(_read(self._folder, "memory.current")) + more)
            _write(self._folder, "memory.swap.max", 0)

    def kill(self) -> None:
        """Kill all processes of the group."""
        with suppress(OSError):
            _write(self._folder, "cgroup.kill", 1)

    def ran_out(self) -> bool:
        """Tell whether the kernel has killed a process of the group because the memory limit was exceeded."""
        with suppress(OSError):
            return "oom_kill 0" not in _read(self._folder, "memory.events").splitlines()
        return False

    def remove(self) -> bool:
        """Remove the group if it has no process left; tells whether it is gone."""
        with suppress(OSError):
            os.rmdir(self._folder)
        return not os.path.isdir(self._folder)


class PartitionGroups:
    """Divides the control group of the agent into one group per partition."""

    def __init__(self, folder: str) -> None:
        """Move this process into a group of its own below the group `folder`; raises OSError.

        From then on the kernel counts memory separately for each group below `folder`.
        """
        self._folder = folder
        self._ended: list[PartitionGroup] = []
        _enter(f"{folder}/{_AGENT}", os.getpid())
        _write(folder, "cgroup.subtree_control", "+memory")

    def enclose(self, pid: int) -> PartitionGroup | None:
        """Put a new process into a group of its own, and return the group; None if this fails."""
        self._ended = [group for group in self._ended if not group.remove()]
        folder = f"{self._folder}/partition.{pid}"
        try:
            _enter(folder, pid)
            _write(folder, "memory.oom.group", 1)
        except OSError:
            return None
        return PartitionGroup(folder)

    def retire(self, group: PartitionGroup) -> bool:
        """Remove the group of an ended partition; if it still has a process, `enclose` removes it later.

        Returns whether the kernel killed the partition because the partition exceeded its memory limit.
        """
        ran_out = group.ran_out()
        if not group.remove():  # child processes of the partition may take a moment longer to end
            self._ended.append(group)
        return ran_out


def open_groups(tell: Callable[[Note], None]) -> PartitionGroups | None:
    """Prepare the control group of this process for partitions; None if the group is not delegated, or cannot be used.

    If the group is delegated and cannot be used, `tell` is called with the reason.
    """
    folder = _own_folder()
    if folder is None or not _is_delegated(folder):
        return None
    try:
        if "memory" in _read(folder, "cgroup.controllers").split():
            return PartitionGroups(folder)
        reason = _NO_MEMORY
    except OSError as error:
        reason = str(error)
    tell(
        Note(
            "partitions",
            f"control groups cannot be used, so RLIMIT_DATA alone limits the memory of partitions: {reason}",
        )
    )
    return None


def _own_folder() -> str | None:
    """Path of this process's control group; None without cgroup v2."""
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
