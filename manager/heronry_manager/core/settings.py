"""What a manager is set to be when it is started: it stays so for as long as it runs."""

from dataclasses import dataclass

from heronry_dg.model import Bus, Spec
from heronry_manager.contingency.on_board import ContingencyNumbers
from heronry_wire.authentication import Key
from heronry_wire.identifiers import FIRST_MANAGER
from heronry_wire.protocol_times import START_UP_WINDOW_NS, t_lease_ns


@dataclass(frozen=True, slots=True)
class ManagerSettings:
    """One manager of one spec.

    node: 126 or 127.
    window_ns: how long PEs that were never heard are waited for.
    advise: it says nothing on the bus, ever, and tells what it would do instead.
    on_board: what PEs that were given their part of the contingency file can be switched to by number.
    key: of the fleet; with one every command is tagged, and nothing is believed that was not.
    standby: it stands by while another manager is active, instead of ending.
    tells_departures: whoever drives it says when an ALIVE is on the bus; else it is taken to be there at once.
    """

    spec: Spec
    node: int
    window_ns: int = START_UP_WINDOW_NS
    advise: bool = False
    on_board: ContingencyNumbers | None = None
    key: Key | None = None
    standby: bool = False
    tells_departures: bool = False

    @property
    def bus(self) -> Bus:
        """The one on which managers speak."""
        return self.spec.buses[self.spec.manager.bus]

    @property
    def lease_ns(self) -> int:
        """T_lease of that bus."""
        return t_lease_ns(self.bus.heartbeat_ns)

    @property
    def goes_first(self) -> bool:
        """Tell whether it may begin as soon as it hears no manager: 126, and whoever is the only one."""
        return self.node == FIRST_MANAGER or not self.standby
