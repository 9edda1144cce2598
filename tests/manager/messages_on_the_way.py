"""A manager and one PE, and each message between them on its way: one of them lost, doubled, late or damaged."""

from collections.abc import Callable, Collection
from heapq import heappop, heappush
from itertools import count

from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.sdo import Abort, abort_message
from manager.one_manager import MS, OneManager

ON_THE_WAY_NS = MS

Change = Callable[[bytes], list[tuple[int, bytes]]]
"""What becomes of a message: how much later each copy comes, and its bytes."""


def changes(index: int, sub_index: int) -> dict[str, Change]:
    """Return what may become of a message, by name; index and sub_index: of the object that an abort names."""
    return {
        "lost": lambda _data: [],
        "doubled": lambda data: [(0, data), (0, data)],
        "late": lambda data: [(200 * MS, data)],
        "very late": lambda data: [(1_500 * MS, data)],
        "damaged": lambda data: [(0, bytes((*data[:-1], data[-1] ^ 1)))],
        "replaced by an abort": lambda _data: [(0, abort_message(index, sub_index, Abort.TIME_OUT))],
    }


class Exchange:
    """The manager, and the frames between it and one PE, which a subclass plays."""

    def __init__(self, manager: OneManager, node: int, change: Change | None, at: int) -> None:
        """change: what becomes of SDO message number `at` between manager and PE; None: nothing."""
        self.manager, self.change, self.at, self.messages = manager, change, at, 0
        self.on_the_way: list[tuple[int, int, Frame]] = []
        self._sdo = sdo_request_id(node), sdo_response_id(node)
        self._order = count()
        self.sent = len(manager.frames)  # how many of the manager's frames have been looked at

    @property
    def identifiers(self) -> Collection[int]:
        """Identifiers of the manager's frames that the PE takes."""
        raise NotImplementedError

    def due_ns(self, end_ns: int) -> int:
        """Time in ns at which the PE is to be called next; not later than `end_ns`."""
        raise NotImplementedError

    def hear(self, frame: Frame) -> None:
        """Give the PE a frame."""
        raise NotImplementedError

    def tick(self) -> None:
        """Give the PE the time."""
        raise NotImplementedError

    def fly(self, until: Callable[[], bool], longest_ns: int) -> bool:
        """Fly until something holds; tells whether it came to hold."""
        end_ns = self.manager.now_ns + longest_ns
        while not until():
            if self.manager.now_ns >= end_ns:
                return False
            self._step(end_ns)
        return True

    def pass_on(self, frame: Frame) -> None:
        """Put a frame on its way; only SDO is counted and changed."""
        copies = [(0, frame.data)]
        if frame.can_id in self._sdo:
            if self.messages == self.at and self.change is not None:
                copies = self.change(frame.data)
            self.messages += 1
        for later_ns, data in copies:
            at_ns = self.manager.now_ns + ON_THE_WAY_NS + later_ns
            heappush(self.on_the_way, (at_ns, next(self._order), Frame(frame.can_id, data)))

    def _step(self, end_ns: int) -> None:
        manager, now_ns = self.manager, self.manager.now_ns
        dues = [self.due_ns(end_ns), manager.core.next_deadline_ns() or end_ns, end_ns]
        dues += [self.on_the_way[0][0]] if self.on_the_way else []
        manager.pass_time(max(1, min(dues) + 1 - now_ns))
        self._collect()
        while self.on_the_way and self.on_the_way[0][0] <= manager.now_ns:
            frame = heappop(self.on_the_way)[2]
            if frame.can_id in self.identifiers:
                self.hear(frame)
            else:
                manager.hear(frame)
                self._collect()
        self.tick()

    def _collect(self) -> None:
        new, self.sent = self.manager.frames[self.sent :], len(self.manager.frames)
        for frame in new:
            if frame.can_id in self.identifiers:
                self.pass_on(frame)
