"""What the frames of a flight show, live or recorded: frames in, events and observations out.

There is a part for each kind of observation:

    traffic    the load of each bus (file `traffic`)
    PEs        the contents of state frames, when they change; when each PE was heard (this file)
    functions  whether their outputs are heard on the manager's bus (file `heronry_tools.runtime.witness`)
    epochs     reconfigurations (file `epochs_on_the_bus`)
    manager    a manager's core that runs in this program. It gets the frames that the active manager gets and sends. It
               tells which PE is lost or joins, as the active manager does. Its plans are dropped

If the manager's own events are available (`tells_why`), the parts `epochs` and `manager` are left out. Nothing is sent.
All times are those of the frames: before a frame is handled, all deadlines up to its time are handled (`until`). So the
same frames give the same events.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.vocabulary import Emit, ManagerAction
from heronry_manager.events import Event
from heronry_tools.runtime.witness import Witness
from heronry_tools.watch.epochs_on_the_bus import EpochsOnTheBus
from heronry_tools.watch.traffic import SLOT_NS, TELL_SLOTS, Traffic
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, MANAGER_NODES, Command, management_id, state_id
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Tick
from heronry_wire.state_frames import PeFlags, StatePage0, StatePage1, decode_state

if TYPE_CHECKING:
    from heronry_manager.core.manager import ManagerCore

_TOLD = (
    events.PeSuspected,
    events.PeAnswered,
    events.PeLost,
    events.PeAbsent,
    events.PeHeardAgain,
    events.PeJoined,
    events.FaultReported,
    events.FaultCleared,
    events.LinkLimited,
    events.LinkGone,
    events.LinkBack,
    events.ChannelLost,
    events.ChannelBack,
    events.PhaseChanged,
    events.PriorityChanged,
    events.ModuleRestarted,
    events.Disagreement,
    events.Agreement,
    events.UnknownElement,
    events.UnknownOutput,
    events.UnknownInput,
    events.StateRestored,
    events.StateLacking,
    events.StateNotSaved,
    events.StateSaved,
    events.InputSilent,
    events.OutputSilent,
    events.SilenceOver,
)
_COMMANDS = {management_id(node, command): (node, command) for node in MANAGER_NODES for command in Command}
_TELL_NS = SLOT_NS * TELL_SLOTS


@dataclass(frozen=True, slots=True)
class _Reported:
    """What the states of a PE have said so far; None: nothing yet."""

    incarnation: int | None = None
    epoch: int | None = None
    runs: str | None = None
    hears_manager: bool | None = None
    load_percent: int | None = None


_NOTHING_REPORTED = _Reported()


class Listening:
    """Observes all buses of one flight."""

    def __init__(
        self,
        spec: Spec,
        begins_ns: int,
        *,
        tells_why: bool = False,
        key: Key | None = None,
        tables: tuple[PeTable, ...] = (),
    ) -> None:
        """Begin at the time `begins_ns` of the frames' clock.

        tells_why: the caller gets the events of the manager itself. Then epochs are not observed here, and no core
            of a manager runs here.
        key: the key of the flight; None: the flight has no key.
        tables: the tables of the PEs, with the contingencies on board.
        """
        self._spec, self._main = spec, spec.manager.bus
        self._traffic = {bus.name: Traffic(bus.name, bus.bitrate) for bus in spec.buses.values()}
        self._witness = Witness(spec)
        self._states = {state_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._reported: dict[str, _Reported] = {}  # by PE
        self._heard: dict[str, int] = {}  # since the last observation `heard`
        self._silent_since_ns: dict[str, int] = {}  # by function: when the last reported silence began
        self._tell_ns = begins_ns + _TELL_NS
        self._core: ManagerCore | None = None
        if not tells_why:
            self._core = _advising_core(spec, begins_ns, key)
            core = self._core
            self._epochs = EpochsOnTheBus(spec, tables, lambda: core.now)

    def take(self, bus: str, t_ns: int, frame: Frame) -> list[Event]:
        """Take a frame that ended at `t_ns` on a bus of the spec.

        Returns the events up to `t_ns`, in order, with those that this frame causes.
        """
        found = self.until(t_ns)
        if bus in self._traffic:
            self._traffic[bus].take(t_ns, frame)
        if frame.error or frame.extended or frame.remote:
            return found
        if frame.can_id in self._states:
            found += self._state(t_ns, self._states[frame.can_id], frame)
        if bus != self._main:
            return found
        self._witness.see(t_ns, frame)
        if self._core is not None:
            if frame.can_id in _COMMANDS:
                found += self._epochs.command(t_ns, *_COMMANDS[frame.can_id], frame.data)
            if self._core.hears(frame.can_id):
                found += self._told(self._core.step(t_ns, Received(0, frame)))
        return found

    def until(self, t_ns: int) -> list[Event]:
        """Return the events before `t_ns` that follow from the passing of time alone, without a new frame."""
        found: list[Event] = list(chain.from_iterable(traffic.until(t_ns) for traffic in self._traffic.values()))
        found += self._deadlines(t_ns)
        if t_ns >= self._tell_ns:
            self._tell_ns = t_ns - (t_ns - self._tell_ns) % _TELL_NS + _TELL_NS
            found += self._heard_until(t_ns)
        return found

    def _deadlines(self, t_ns: int) -> list[Event]:
        found: list[Event] = []
        core = self._core
        while core is not None and (due_ns := core.next_deadline_ns()) is not None and due_ns < t_ns:
            found += self._told(core.step(due_ns, Tick()))
            after_ns = core.next_deadline_ns()
            if after_ns is not None and after_ns <= due_ns:  # the core has nothing to do before the first frame
                break
        return found

    def _told(self, actions: list[ManagerAction]) -> Iterator[Event]:
        for action in actions:
            if isinstance(action, Emit) and isinstance(action.event, _TOLD):
                event = action.event
                if isinstance(event, events.PeLost):
                    self._epochs.lost(event.t_ns, event.last_heard_ns, self._spec.pes[event.pe].node_id)
                yield event

    def _state(self, t_ns: int, pe: str, frame: Frame) -> Iterator[Event]:
        page = decode_state(frame.data)
        self._heard[pe] = t_ns
        before = self._reported.get(pe, _NOTHING_REPORTED)
        after = before
        if isinstance(page, StatePage1):
            if self._core is not None:
                self._epochs.page_1(self._spec.pes[pe].node_id, page)
            after = replace(before, load_percent=page.load)
        elif isinstance(page, StatePage0):
            hears = PeFlags.HEARS_LEASE in page.flags
            after = _Reported(page.incarnation, page.epoch or None, page.state.name, hears, before.load_percent)
        if after != before and after.incarnation is not None:
            yield events.PeSeen(
                t_ns, pe, after.incarnation, after.epoch, after.runs, after.hears_manager, after.load_percent
            )
        self._reported[pe] = after
        if isinstance(page, StatePage0) and self._core is not None:
            yield from self._epochs.page_0(t_ns, self._spec.pes[pe].node_id, page)

    def _heard_until(self, t_ns: int) -> Iterator[Event]:
        """Yield an observation of when PEs and functions were last heard, and the events of silent functions.

        The observation has the PEs that were heard since the last observation, and all functions that were ever heard.
        A silence of a function gives an event when it is found, and another event when it has ended.
        """
        functions: dict[str, tuple[int, bool]] = {}
        for name in self._spec.functions:
            output = self._witness.last_output(name)
            if output is not None:
                functions[name] = output.t_ns, self._witness.served(name, t_ns)
        yield events.Heard(t_ns, self._heard, functions)
        self._heard = {}
        for outage in self._witness.outages(t_ns):
            if outage.to_ns is not None or self._silent_since_ns.get(outage.function) != outage.from_ns:
                self._silent_since_ns[outage.function] = outage.from_ns
                yield events.Outage(t_ns, outage.function, outage.from_ns, outage.to_ns, gathered=False)
        self._witness.forget()


def _advising_core(spec: Spec, begins_ns: int, key: Key | None) -> "ManagerCore":
    from heronry_manager.core.manager import ManagerCore  # noqa: PLC0415 - loads slowly, and is not needed beside a manager

    return ManagerCore(spec, FIRST_MANAGER, NOTHING, begins_ns, advise=True, key=key)
