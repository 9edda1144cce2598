"""Reconfigurations as a bus shows them: by PREPARE, by ACTIVATE, and by the states in which PEs report the epoch.

The bus shows when an epoch was prepared, when it was activated, and when every PE that is heard has reported it. It
does not show why. So the times to detect and to decide are known only if the loss of a PE was noticed before (`lost`):
the time to detect begins with the last frame of that PE, and the time to decide begins when the PE was called lost.
"""

from collections.abc import Callable, Iterator

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import make_plan
from heronry_dg.plan_document import PlanDocument
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.topology import reached_by_wire
from heronry_tools.recording.commanded import Commanded, Epoch
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import Command
from heronry_wire.management import Activate, Lease, ManagementMessage, Step, decode_command
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeState, StatePage0, StatePage1

_FOLLOWS_NS = 10_000_000_000  # an epoch that is prepared later than this after a loss has another cause


class EpochsOnTheBus:
    """Reads the frames of one flight, and reports the epochs of this flight as events."""

    def __init__(self, spec: Spec, tables: tuple[PeTable, ...], now: Callable[[], Situation]) -> None:
        """Begin to observe.

        tables: the tables of the PEs, with the contingencies on board.
        now: gives the situation as it is known.
        """
        self._spec, self._now = spec, now
        self._commanded = Commanded(spec, tables)
        self._wired = {spec.pes[pe].node_id for pe in reached_by_wire(spec)}
        self._reported: dict[int, StatePage0] = {}  # by node
        self._active: Epoch | None = None
        self._told: tuple[int, int] | None = None  # epoch and digest
        self._unknown: int | None = None
        self._manager: tuple[int, int] | None = None
        self._lost: tuple[int, int] | None = None  # of the last lost PE: when it was called lost, and its last frame

    def lost(self, t_ns: int, last_heard_ns: int | None, node: int) -> None:
        """Note the loss of a PE at `t_ns`; from now on no epoch waits for a report of this PE.

        last_heard_ns: time of the last frame of the PE; None: unknown, so the time to detect is taken to be 0.
        """
        self._reported.pop(node, None)
        self._lost = t_ns, t_ns if last_heard_ns is None else last_heard_ns

    def command(self, t_ns: int, node: int, command: Command, data: bytes) -> Iterator[events.Event]:
        """Take a command of a manager; yields the events that follow from it.

        An event reports one of these: another manager or term, an epoch of unknown content, an epoch that every PE
        runs.
        """
        message = decode_command(command, data)
        if isinstance(message, Malformed):
            return
        self._commanded.take(t_ns, message)
        if isinstance(message, Lease):
            yield from self._lease(t_ns, node, message)
        self._note_active(message)
        yield from self._done(t_ns)

    def page_0(self, t_ns: int, node: int, page: StatePage0) -> Iterator[events.Event]:
        """Take page 0 of a PE's state.

        Yields an event if the epoch that was activated last now runs on every PE that is heard, and if this
        was not reported yet.
        """
        self._reported[node] = page
        yield from self._done(t_ns)

    def page_1(self, node: int, page: StatePage1) -> None:
        """Note from page 1 of a PE's state how far the PE has staged an epoch."""
        self._commanded.staged(node, page)

    def _lease(self, t_ns: int, node: int, lease: Lease) -> Iterator[events.Event]:
        said = node, lease.term
        if said != self._manager:
            self._manager = said
            yield events.ManagerSeen(t_ns, node, lease.term)
        is_known = lease.epoch in self._commanded.epochs
        if lease.epoch and not is_known and lease.step is Step.GO_ALL and self._unknown != lease.epoch:
            self._unknown = lease.epoch
            yield events.UnknownEpoch(t_ns, lease.epoch)

    def _note_active(self, message: ManagementMessage) -> None:
        if isinstance(message, Activate | Lease) and message.step is not Step.PREPARED:
            self._active = self._commanded.epochs.get(message.epoch, self._active)

    def _done(self, t_ns: int) -> Iterator[events.Event]:
        epoch = self._active
        if epoch is None or epoch.activated_ns is None or (epoch.number, epoch.digest) == self._told:
            return
        awaited = {node: page for node, page in self._reported.items() if node in self._wired}
        if not awaited or any(
            page.epoch != epoch.number or page.state is not PeState.ACTIVE for page in awaited.values()
        ):
            return
        self._told = epoch.number, epoch.digest
        plan = None if epoch.configuration is None else self._plan(epoch.configuration)
        times, began_ns = self._times(epoch, t_ns)
        yield events.EpochSeen(t_ns, epoch.number, plan, began_ns, times)

    def _times(self, epoch: Epoch, t_ns: int) -> tuple[events.Times, int]:
        activated_ns = epoch.activated_ns or epoch.prepared_ns
        detect_ns = decide_ns = None
        began_ns, lost = epoch.prepared_ns, self._lost
        if lost is not None and 0 <= epoch.prepared_ns - lost[0] < _FOLLOWS_NS:
            began_ns = lost[1]
            detect_ns, decide_ns = lost[0] - lost[1], epoch.prepared_ns - lost[0]
        self._lost = None
        return events.Times(detect_ns, decide_ns, activated_ns - epoch.prepared_ns, t_ns - activated_ns), began_ns

    def _plan(self, configuration: Configuration) -> PlanDocument:
        now = self._now()
        worth = score(self._spec, now, configuration, None)
        return make_plan(self._spec, now, configuration, worth, optimal=False).told()
