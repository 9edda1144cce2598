"""The partitions of a PE that has a loader: those of modules whose code is not installed import from its active bundle.

Such a module has a partition of its own kind, which the loader may end and start anew: that of the table, with "+"
behind its name (`table_for_loader`). So no module whose code is installed ever stops or fails because of a bundle.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from heronry_agent.core.vocabulary import Action, ControlProgram, ImagesMissing, KeepParts, ModuleEvent, WriteProgram
from heronry_agent.loader.code_loader import CodeLoader
from heronry_agent.loader.keeper_process import KeeperProcess
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.partition_groups import PartitionGroups
from heronry_agent.shell.partition_host import WARM_UP_NS, PartitionHost
from heronry_wire.bundle import BundleError
from heronry_wire.bundle_keys import PUBLIC, read_key_file
from heronry_wire.pe_table import ModuleEntry, PeTable


def table_for_loader(table: PeTable, missing: Collection[str]) -> PeTable:
    """Return the table with a partition of their own for modules whose image is missing and names its Python module."""
    return table.with_partitions({index: f"{entry.partition}+" for index, entry in own_modules(table, missing).items()})


def own_modules(table: PeTable, missing: Collection[str]) -> dict[int, ModuleEntry]:
    """Return the modules that a loader may bring code for, by index."""
    return {entry.index: entry for entry in table.modules if entry.image in missing and ":" in entry.image}


class LoadingHost(PartitionHost):
    """Runs the partitions of one PE, and lets its loader see what they do."""

    def __init__(
        self,
        table: PeTable,
        devices: Devices,
        groups: PartitionGroups | None,
        loader: CodeLoader,
        lacking: Mapping[str, str],
    ) -> None:
        """Begin without partitions.

        loader: the loader of this PE.
        lacking: images whose code is not installed on this node; only those that the loader has are imported.
        """
        super().__init__(table, devices, groups)
        self._loader, self._lacking = loader, frozenset(lacking)
        self._own = frozenset(entry.partition for entry in own_modules(table, lacking).values())
        self._cold = [name for name in self._cold if self._images_of(name)]
        self._events: list[ModuleEvent] = []

    def watch(self, now_ns: int) -> tuple[list[Any], int]:
        """Return what `select` is to wait for, and when to call `take` at the latest."""
        watched, due_ns = super().watch(now_ns)
        due_ns = now_ns if self._events else min(due_ns, self._loader.next_ns)
        return [*watched, *self._loader.readers], due_ns

    def carry_out(self, action: Action, now_ns: int) -> ModuleEvent | None:
        """Execute an action; what the loader answers comes with the next `take`."""
        self._events += self._loader.ordered(action, now_ns)
        if isinstance(action, WriteProgram | KeepParts | ControlProgram):
            return None
        answer = super().carry_out(action, now_ns)
        if answer is not None:
            self._events += self._loader.heard(answer, now_ns)
        return answer

    def take(self, ready: Collection[object], now_ns: int) -> list[ModuleEvent]:
        """Read the answers of partitions and of the loader; returns the events for the core."""
        events: list[ModuleEvent] = []
        for event in super().take(ready, now_ns):
            self._events += self._loader.heard(event, now_ns)
            events += self._still_true(event)
        self._events += self._loader.take(ready, now_ns)
        if self._loader.is_changed:
            self._loader.is_changed = False
            self._renew(now_ns)
        events, self._events = events + self._events, []
        return events

    def abandon(self) -> None:
        """End all partitions without a report to the core."""
        super().abandon()
        self._loader.abandon()

    def close(self) -> None:
        """End all partitions and the loader's process."""
        super().close()
        self._loader.close()

    def _still_true(self, event: ModuleEvent) -> Iterator[ModuleEvent]:
        """Yield an event for the core; the code that is back may have the images that failed code did not give."""
        if not isinstance(event, ImagesMissing):
            yield event
        elif missing := {image: why for image, why in event.images.items() if image not in self._loader.images}:
            yield ImagesMissing(missing)

    def _renew(self, now_ns: int) -> None:
        """End the partitions that import from a bundle; those that hold code now are started in advance."""
        for name in self._own:
            process = self._processes.get(name)
            if process is None or process.code == self._code_of(name):
                continue  # it imports, or will import, from the code that is active now
            if self._loader.runs(name):
                process.broken = "its code was taken back"
            else:
                self._end(name, tell=False)
        self._cold += [name for name in sorted(self._own) if self._images_of(name) and name not in self._cold]
        if self._processes and self._cold:
            self._warm_ns = now_ns + WARM_UP_NS

    def _images_of(self, name: str) -> tuple[str, ...]:
        here = self._loader.images
        return tuple(image for image in super()._images_of(name) if image not in self._lacking or image in here)

    def _code_of(self, name: str) -> str | None:
        return self._loader.path if name in self._own else None


@dataclass(frozen=True, slots=True)
class Code:
    """The loader of one PE, the PE's table as this loader needs it, and what is not installed on the node."""

    loader: CodeLoader
    table: PeTable
    missing: Mapping[str, str]

    def host(self, devices: Devices, groups: PartitionGroups | None) -> LoadingHost:
        """Return the host of this PE's partitions."""
        return LoadingHost(self.table, devices, groups, self.loader, self.missing)


def open_code(
    folder: Path, key: Path | None, table: PeTable, missing: Mapping[str, str], tell: Callable[[str], None]
) -> Code:
    """Open the loader whose code is in `folder`; raises BundleError where the key or what checks it is missing.

    key: file of the public key; None: code need not be signed.
    """
    if find_spec("packaging") is None or (key is not None and find_spec("cryptography") is None):
        raise BundleError('--code-dir needs cryptography, which is not installed: pip install "heronry[bundle]"')
    if key is not None:
        read_key_file(key, PUBLIC)
    table = table_for_loader(table, missing)
    keeper = KeeperProcess(folder.absolute(), key)
    return Code(CodeLoader(folder.absolute(), keeper, own_modules(table, missing), tell), table, missing)
