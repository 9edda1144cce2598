"""Orders to fly by another spec: reads the file, and builds what the next core needs, beside the loop of the manager.

    reading     a thread reads and compiles the spec of an order, since that may take longer than a heartbeat period
    on its way  the core has the order. It asks for the first configuration (`first`), which takes as long as an
                immediate plan
    changed     the PEs fly by the other spec: the driver takes it from here (`takes_over`)
    at hand     the spec of an order `for_standby`: the core knows its digest. When the aircraft has changed to it, the
                driver takes it from here (`follows`). It is kept beside the journal, and read again after a restart

An order that comes while another one is on its way is given to the core, too, which refuses it: the other spec stays
that of the first order. Where an order ends without a change, its spec is forgotten.

The planners of the other spec load the solver while its tables are on their way. The loop of the manager starts them,
not the thread, with which they would end (`parent_death`); another thread ends them, since that may take a moment.

The operator has seen what changes before the order: an order names the digest of the spec that was shown, and a file
that has changed since then is refused. One order is read at a time.

A file may be edited at any time, also while the aircraft flies by it. So the manager keeps copies: of the spec by which
the aircraft flies (with which `heronry reload` compares the next one), and of the one before (`heronry reload --back`).
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread

from heronry_dg.model import Spec
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.vocabulary import OperatorSaid, ReloadSpec, Reply, RequestSwitch, SpecAtHand, SwitchReady
from heronry_manager.shell.control_protocol import Reload
from heronry_manager.shell.other_spec import OtherSpec
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_wire.errors import HeronryError

_NOBODY = 0  # in the place of the number of an order: no caller waits for a reply

Load = Callable[[Path], Spec]
"""Reads the spec in a file; raises HeronryError."""


@dataclass(frozen=True, slots=True)
class Successor:
    """What flies by another spec.

    start: starts its planners. make: makes its core and its planners' owner, from the memory and the time in ns.
    close: ends its planners, whether they were started or not. None of them raises anything.
    """

    start: Callable[[], None]
    make: Callable[[Memory, int], tuple[ManagerCore, PlannerProcesses]]
    close: Callable[[], None]


Prepare = Callable[[OtherSpec, Path], Successor]
"""Makes ready what flies by another spec; raises HeronryError."""


@dataclass(frozen=True, slots=True)
class Next:
    """Another spec, with all that is needed to fly by it."""

    other: OtherSpec
    file: Path
    copy: Path
    order: ReloadSpec
    successor: Successor


class SpecReloads:
    """The other spec of one manager, if there is one."""

    def __init__(
        self, spec: Spec, file: Path, load: Load, prepare: Prepare, copies: Path, *, close: Callable[[], None]
    ) -> None:
        """Begin without another spec; `spec`: by which the aircraft flies, from `file`.

        copies: an empty folder. close: ends the planners of `spec`.
        """
        self._spec, self._load, self._prepare, self._close = spec, load, prepare, close
        self._copies, self._count = copies, 0
        self.before: Path | None = None
        self.flies = self._copy(file)
        self._read: SimpleQueue[tuple[int, Reload, Next | str]] = SimpleQueue()
        self._is_reading = False
        self._next: Next | None = None
        self._at_hand: Next | None = None
        self._kept: Path | None = None

    def resume(self, folder: Path) -> None:
        """Keep the spec at hand in a folder of its own from now on, and begin to read what was kept there."""
        self._kept = folder
        kept = sorted(folder.glob("*.yaml")) if folder.is_dir() else []
        if kept:
            self.begin(_NOBODY, Reload(str(kept[0]), for_standby=True))

    def begin(self, number: int, order: Reload) -> Reply | None:
        """Begin to read the spec of an order; returns the reply if it is refused at once."""
        if self._is_reading:
            return Reply(number, done=False, sentence="another spec is being read: give the order again")
        self._is_reading = True
        Thread(target=self._read_one, args=(number, order), daemon=True).start()
        return None

    def poll(self, *, is_changing: bool) -> Iterator[OperatorSaid | SpecAtHand | Reply]:
        """Yield what the core is told, and the reply where the core gives none, once a spec has been read.

        is_changing: whether the core carries out an order.
        """
        if self._next is not None and not is_changing:  # refused, or given up
            _in_background(self._next.successor.close)
            self._next = None
        try:
            number, order, found = self._read.get_nowait()
        except Empty:
            return
        self._is_reading = False
        if isinstance(found, str):
            yield Reply(number, done=False, sentence=found)
        elif order.for_standby:
            self._puts_at_hand(found)
            yield SpecAtHand(found.order.digest)
            yield Reply(number, done=True, sentence=f"{found.order.name} is at hand, for when the aircraft flies by it")
        else:
            if is_changing:
                found.successor.close()
            else:
                self._next = found
                found.successor.start()
            yield OperatorSaid(number, found.order)
        self._tidy()

    @property
    def is_reading(self) -> bool:
        """Tell whether `poll` will yield something soon."""
        return self._is_reading

    def first(self, request: RequestSwitch) -> SwitchReady:
        """Return the first configuration of the other spec."""
        if self._next is None:
            return SwitchReady(request.number, problem="there is no other spec")
        return self._next.other.first(request)

    def takes_over(self) -> Next:
        """Return what flies from now on."""
        found, self._next = self._next, None
        return self._flies(found)

    def follows(self) -> Next:
        """Return what was at hand, and flies from now on."""
        found, self._at_hand = self._at_hand, None
        return self._flies(found)

    def _puts_at_hand(self, found: Next) -> None:
        if self._at_hand is not None:
            _in_background(self._at_hand.successor.close)
        self._at_hand = found
        found.successor.start()

    def _flies(self, found: Next | None) -> Next:
        assert found is not None
        _in_background(self._close)
        self._spec, self._close = found.other.spec, found.successor.close
        self.before, self.flies = self.flies, found.copy
        return found

    def files(self) -> dict[str, str | None]:
        """Return what the status shows: the copies of the spec that flies, and of the one before."""
        return {"flies": str(self.flies), "before": None if self.before is None else str(self.before)}

    def _tidy(self) -> None:
        """Remove the copies that nobody needs any more; none is being made meanwhile."""
        needed = [self.flies, self.before, *(one.copy for one in (self._next, self._at_hand) if one is not None)]
        for folder in {*self._copies.iterdir()} - {copy.parent for copy in needed if copy is not None}:
            shutil.rmtree(folder, ignore_errors=True)

    def _copy(self, file: Path) -> Path:
        """Copy a file under its own name, from which a spec may have its own."""
        folder = self._copies / str(self._count)
        folder.mkdir()
        self._count += 1
        return Path(shutil.copyfile(file, folder / file.name))

    def _read_one(self, number: int, order: Reload) -> None:
        file = Path(order.file)
        found: Next | str
        try:
            found = self._read_file(file, order.digest)
            if order.for_standby and isinstance(found, Next):
                self._keep(found.copy)
        except HeronryError as error:
            found = str(error)
        except OSError as error:
            found = f"{file}: {error.strerror}"
        except Exception as error:  # noqa: BLE001 - the loop of the manager must go on, whatever a spec makes fail
            found = f"{file} cannot be read: {type(error).__name__}: {error}"
        self._read.put((number, order, found))

    def _keep(self, copy: Path) -> None:
        """Keep the copy of the spec at hand for a restart, in the place of the one before."""
        if self._kept is None:
            return
        draft = self._kept / "draft"
        with suppress(OSError):  # a full disk costs only the copy for a restart
            self._kept.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(copy, draft)
            for before in self._kept.glob("*.yaml"):
                before.unlink()
            draft.replace(self._kept / copy.name)

    def _read_file(self, file: Path, digest: str) -> Next | str:
        copy = self._copy(file)
        spec = self._load(copy)
        if digest not in ("", spec.digest):
            return f"{file} has changed since it was shown: give the order again"
        other = OtherSpec(spec)
        told = other.order(self._spec)
        if isinstance(told, str):
            return told
        other.warm_up()
        return Next(other, file, copy, told, self._prepare(other, copy))


def _in_background(end: Callable[[], None]) -> None:
    Thread(target=end, daemon=True).start()
