"""The settings of a manager: given when it is started, and the same for as long as it runs."""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_dg.model import Bus, Spec
from heronry_manager.core.tables import Compiler, ContingencyNumbers
from heronry_wire.authentication import Key
from heronry_wire.identifiers import FIRST_MANAGER
from heronry_wire.protocol_times import START_UP_WINDOW_NS, t_lease_ns


@dataclass(frozen=True, slots=True)
class CodeBundle:
    """A bundle of code (`heronry_wire.bundle`) that a manager may bring to PEs, read and checked.

    content: its bytes, which go over the bus.
    """

    name: str
    version: int
    images: frozenset[str]
    content: bytes


@dataclass(frozen=True, slots=True)
class ManagerSettings:
    """The settings of one manager of a spec.

    compiler: compiles configurations of the spec.
    node: 126 or 127.
    window_ns: how long the manager waits for PEs that it has never heard, in nanoseconds.
    advise: the manager sends nothing on the bus, and only reports what it would do.
    on_board: the numbers by which PREPARE names configurations to PEs that have their slices of them on board; None:
        PREPARE names none by number.
    key: key of the fleet; with it every command is tagged, and the manager believes nothing without a tag.
    standby: the manager stands by while another manager is active; without this setting it ends.
    tells_departures: the driver reports when an ALIVE is on the bus; if False, each ALIVE counts as sent immediately.
    reads_objects: the manager reads by SDO the details that PEs store for people (`pe_details`).
    tables: the table of each PE, compressed, by its name, for a PE that waits without one; None: none is brought.
    bundles: code for PEs that lack it.
    """

    spec: Spec
    compiler: Compiler
    node: int
    window_ns: int = START_UP_WINDOW_NS
    advise: bool = False
    on_board: ContingencyNumbers | None = None
    key: Key | None = None
    standby: bool = False
    tells_departures: bool = False
    reads_objects: bool = False
    tables: Mapping[str, bytes] | None = None
    bundles: tuple[CodeBundle, ...] = ()

    @property
    def bus(self) -> Bus:
        """The manager's bus."""
        return self.spec.buses[self.spec.manager.bus]

    @property
    def lease_ns(self) -> int:
        """T_lease of the manager's bus, in nanoseconds."""
        return t_lease_ns(self.bus.heartbeat_ns)

    @property
    def goes_first(self) -> bool:
        """Tell whether this manager may begin a term as soon as it has listened and heard no other manager.

        It may if it has node-ID 126, or if `standby` is False.
        """
        return self.node == FIRST_MANAGER or not self.standby
