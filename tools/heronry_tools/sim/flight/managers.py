"""The managers of one simulated flight: they start, die, may be started twice, and report their events.

Each manager runs on a computer of its own, called its *seat*. The number of a seat is the node-ID of the manager; a
second manager with the same node-ID on another computer has the negative number. Each seat has a disk with a journal,
which stays when the manager dies. A manager starts with the spec by which the manager of its seat flew last.
"""

from collections.abc import Callable, Mapping
from random import Random
from typing import TypeVar

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.settings import CodeBundle
from heronry_tools.sim.faults.protocol_state import ProtocolState
from heronry_tools.sim.flight.wiring import Wiring
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.local_clock import LocalClocks
from heronry_tools.sim.world.next_spec import NextSpec
from heronry_tools.sim.world.planning import Planners, Prepared
from heronry_tools.sim.world.simulated_manager import SimulatedManager
from heronry_wire.authentication import Key
from heronry_wire.identifiers import FIRST_MANAGER

_E = TypeVar("_E", bound=events.Event)
_OF_A_STANDBY = (
    events.ManagerStarted,
    events.StandingBy,
    events.SteppedDown,
    events.HearsNobody,
    events.Refused,
    events.SecondManager,
    events.Stopped,
)


class Managers:
    """The one or two managers of a flight.

    running: the managers that run, by the number of the seat (the computer) on which each runs.
    """

    def __init__(
        self,
        spec: Spec,
        clock: Clock,
        clocks: LocalClocks,
        wiring: Wiring,
        *,
        disks: dict[int, Disk],
        checks: Checks,
        are_two: bool,
        key: Key | None,
        prepared: Prepared,
        planners: Planners,
        decide_ns: Callable[[], int],
        brings_tables: bool,
        bundles: tuple[CodeBundle, ...] = (),
    ) -> None:
        """Create the managers, without starting one.

        are_two: whether managers 126 and 127 fly, each being the standby manager while the other is active
        disks: the disk with the journal of each manager, by the number of its seat (see the head of this file)
        key: the key of managers and PEs; None without authentication
        decide_ns: returns the time that the next planning run takes
        brings_tables: whether a manager brings a node without a table its table
        bundles: code that the managers bring
        """
        self.running: dict[int, SimulatedManager] = {}
        self.events: list[events.Event] = []
        self.protocol = ProtocolState(clock)
        self.are_two = are_two
        self.disks = disks
        self._spec, self._clock, self._clocks = spec, clock, clocks
        self._wiring, self._checks = wiring, checks
        self._brings_tables, self._bundles = brings_tables, bundles
        self.code_brought: Callable[[str], None] = lambda _: None
        """Is called with the name of a PE when a manager has brought it code."""
        self._key, self._planners, self._decide_ns = key, planners, decide_ns
        self._first = spec, prepared
        self._flown: dict[int, tuple[Spec, Prepared]] = {}  # by seat: the spec with which its manager starts next

    @property
    def foremost(self) -> SimulatedManager | None:
        """Return the active manager; if two are active, the one with the higher term.

        If no manager is active, return the running manager with the lowest node-ID. None: no manager runs.
        """
        active_manager = [one for one in self.running.values() if one.core.is_active]
        first = next((self.running[seat] for seat in sorted(self.running, key=abs)), None)
        return max(active_manager, key=lambda one: one.core.term, default=first)

    @property
    def commanding(self) -> SimulatedManager | None:
        """Return the active manager; None if its processor is paused or no manager is active."""
        manager = self.foremost
        return manager if manager is not None and manager.is_awake and manager.core.is_active else None

    def events_of(self, kind: type[_E]) -> list[_E]:
        """Return the events of one kind, from all managers, among the events that are kept."""
        return [event for event in self.events if isinstance(event, kind)]

    def start(self, seat: int = FIRST_MANAGER, *, advise: bool = False, standby: bool | None = None) -> None:
        """Start the manager on a seat (a computer, see the head of this file), with the journal on the seat's disk.

        advise: whether the manager only advises: it decides, but sends nothing
        standby: whether it waits while another manager is active; None: it does so if there are two managers
        """
        spec, prepared = self._flown.get(seat, self._first)

        def switched(following: NextSpec) -> None:
            self._flown[seat] = following.spec, following.ahead
            self._checks.manager_flies(self._clock.now_ns, _station(seat), following.spec)

        self._checks.manager_flies(self._clock.now_ns, _station(seat), spec)
        self.running[seat] = SimulatedManager(
            self._clock,
            self._clocks.draw(),
            spec,
            self._wiring.wires[self._spec.manager.bus],
            node=abs(seat),
            disk=self.disks[seat],
            name=_station(seat),
            advise=advise,
            key=self._key,
            standby=self.are_two if standby is None else standby,
            planners=self._planners,
            ahead=prepared,
            decide_ns=self._decide_ns,
            tell=lambda told: self._tell(seat, told),
            planned=self._checks.planning,
            witness=self._checks.copied,
            brings_tables=self._brings_tables,
            bundles=self._bundles,
            switched=switched,
        )

    def double(self, node: int, *, standby: bool) -> None:
        """Start a second manager with the same node-ID on another computer, with a copy of the first one's journal."""
        self._flown[-node] = self._flown.get(node, self._first)
        self.disks[-node] = Disk(self._flown[-node][0], self.disks[node].data)
        self._checks.manager_copied(_station(node), _station(-node))
        self.start(-node, standby=standby)

    def kill(self, seat: int | None = None, *, torn: Random | None = None) -> None:
        """Kill the manager of a seat now.

        seat: None stands for the active manager; if no manager is active, for the one with the lowest node-ID.
        torn: draws how much of the last records a loss of power leaves on the disk of the manager; None: all stays.
        """
        victim = self.foremost if seat is None else self.running.get(seat)
        for number, one in list(self.running.items()):
            if one is victim:
                one.stop()
                del self.running[number]
                if torn is not None:
                    one.disk.torn(torn, self._clock.now_ns)
                    self._checks.may_forget_phase()
                self._checks.manager_died(self._clock.now_ns, _station(number))
        self.see_active_manager()

    def see_active_manager(self) -> None:
        """Set in the object `protocol` whether an active manager can be heard: one that is not paused and can send."""
        active_manager = (
            m for m in self.running.values() if m.core.is_active and m.is_awake and m.stations[0][1].can_send
        )
        self.protocol.set_active_manager(is_heard=any(active_manager))

    def _tell(self, seat: int, event: events.Event) -> None:
        """Keep an event of the manager that `running` has under the number `seat`.

        While another manager is the active one, keep the event only if its kind is in `_OF_A_STANDBY`.
        """
        if isinstance(event, events.CodeBrought):
            self.code_brought(event.pe)
        foremost = self.foremost
        self.see_active_manager()
        if foremost is not None and foremost.core.is_active and foremost is not self.running.get(seat):
            if not isinstance(event, _OF_A_STANDBY):
                return
            self.events.append(event)
            return
        self.events.append(event)
        self.protocol.take(event)


def _station(seat: int) -> str:
    return f"manager {seat}" if seat > 0 else f"manager {-seat} again"


def journal(disks: Mapping[int, Disk], station: str) -> bytes | None:
    """Return the bytes of the journal of the manager at a station.

    None: the disk of this manager takes no more bytes now, or a record that the manager wrote is not on the disk.
    """
    disk = next(disk for seat, disk in disks.items() if _station(seat) == station)
    return None if disk.refuses or disk.problem is not None else disk.data
