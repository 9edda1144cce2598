"""The configurations that the managers have commanded, by epoch, read back from the frames.

PREPARE opens an epoch. Then SLICE frames bring one slice for each PE that takes part in the epoch:

    head      the first frame of a slice: it names the PE, the length of the slice, and a digest
    bodies    the frames after the head: they bring the bytes of the slice. They are not sent if the digest is that of
              bytes that were sent before or are on board

If PREPARE names a contingency by its number, a PE without a head takes the slice that its table has under that number.
While an epoch is being prepared, a manager may still send slices of the previous epoch to a PE that is late. Each
command names its epoch, so the oracle can tell the slices of the two epochs apart.

From the first ACTIVATE of an epoch on, the oracle puts the configuration together as soon as it has seen all slices.
The slice of a PE beyond a radio may come later, since the manager does not wait for such a PE.

A manager that is not active may also prepare epochs. They are kept apart, since no PE has to accept their commands. A
later active manager may adopt such an epoch: the LEASE of this manager names the epoch in a higher term.

Everything is read from frames. So if a slice was never on the bus, the configuration cannot be put together
(`Epoch.flaw`).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_manager.core.topology import reached_by_wire
from heronry_wire.configuration_slice import Slice, SliceError, configuration_digest, decode_slice, slice_digest
from heronry_wire.management import (
    SLICE_BYTES_PER_FRAME,
    Activate,
    ElementKind,
    Lease,
    ManagementMessage,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import StatePage1


def elements_by_kind(spec: Spec) -> dict[ElementKind, list[str]]:
    """Return the elements of each kind in the order of their indices in CONTROL and EMCY."""
    return {
        ElementKind.PE: [f"pe:{pe}" for pe in spec.pes],
        ElementKind.DEVICE: [f"device:{device}" for device in spec.devices],
        ElementKind.MODULE: [f"module:{module}" for module in spec.modules],
        ElementKind.BUS: [f"bus:{bus}" for bus in spec.buses],
    }


def _low(message: ManagementMessage) -> int:
    """Return the low byte of the epoch that a command names; -1 if the command names no epoch."""
    match message:
        case SliceHead() | SliceBody():
            return message.epoch_low
        case Prepare() | Activate() | Lease():
            return message.epoch & 0xFF
        case _:
            return -1


@dataclass(slots=True)
class Epoch:
    """An epoch, as read from its commands.

    Its `configuration` is set when the epoch was activated and all its slices are known.
    """

    number: int
    digest: int
    prepared_ns: int
    term: int  # the term in which it was prepared first
    contingency: int = 0
    heads: dict[int, SliceHead] = field(default_factory=dict)  # by the node of the slice
    bodies: dict[int, dict[int, bytes]] = field(default_factory=dict)
    staged: set[int] = field(default_factory=set)  # nodes that have reported the epoch as staged
    activated_ns: int | None = None  # time of its first ACTIVATE
    is_adopted: bool = False  # the term that activated it first is higher than the term that prepared it
    configuration: Configuration | None = None
    flaw: str | None = None  # why no configuration can be put together

    def has(self, node: int) -> bool:
        """Tell whether a node takes part in the epoch.

        The answer is yes if a slice was sent to the node, or if the node has staged a slice that it had on board.
        """
        return node in self.heads or node in self.staged


class Commanded:
    """Puts the configuration of each epoch together from the commands on the managers' bus."""

    def __init__(self, spec: Spec, tables: Iterable[PeTable] = ()) -> None:
        """Begin without epochs.

        tables: the tables of the PEs, with the contingencies on board; without the table of a PE none of its slices is
            recognized.
        """
        self._spec = spec
        told = {table.node_id: table for table in tables}
        self._on_board = {node: table.preloaded() for node, table in told.items()}
        self._identities = {node: table.identity for node, table in told.items()}
        self._identities |= {pe.node_id: b"" for pe in spec.pes.values() if pe.node_id not in told}
        self._modules = list(spec.modules.values())
        self._sources = list(spec.sources())
        self._leaves = {
            (i, j): len(list(mode.leaves()))
            for i, module in enumerate(self._modules)
            for j, mode in enumerate(module.modes.values())
        }
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._wired = {spec.pes[pe].node_id for pe in reached_by_wire(spec)}
        # Keyed by node, length and digest, as in a PE: two slices of one flight may have equal 24-bit digests.
        self._bytes = {
            (pe.node_id, len(body), slice_digest(self._identities[pe.node_id], body)): body
            for pe in spec.pes.values()
            for body in {b"", *(one.slice for one in self._on_board.get(pe.node_id, ()))}
        }
        self._prepared: dict[int, Epoch] = {}  # by the low byte of the epoch number: the last epoch prepared
        self._apart: dict[int, Epoch] = {}  # the same, for epochs of managers that are not active
        self.epochs: dict[int, Epoch] = {}  # activated ones
        self.current: Epoch | None = None

    def take(self, t_ns: int, message: ManagementMessage, *, is_active: bool = True) -> Epoch | None:
        """Read a command; return an activated epoch as soon as its configuration is known, else None.

        Each epoch is returned once. If its configuration certainly cannot be put together, the epoch is returned with a
        `flaw`.

        is_active: False for a command of a manager that is not active; such commands are kept apart.
        """
        prepared = self._prepared if is_active else self._apart
        epoch = prepared.get(_low(message))
        match message:
            case Prepare() if epoch is None or (epoch.number, epoch.digest) != (message.epoch, message.digest):
                prepared[message.epoch & 0xFF] = Epoch(
                    message.epoch, message.digest, t_ns, message.term, message.contingency
                )
                return None
            case SliceHead() if epoch is not None:
                epoch.heads[message.node] = message
            case SliceBody() if epoch is not None:
                epoch.bodies.setdefault(message.node, {})[message.index] = message.body
                self._keep(epoch.heads.get(message.node), epoch.bodies[message.node])
            case Activate() | Lease() if message.step is not Step.PREPARED and is_active:
                named = message.epoch, message.digest
                epoch = next((one for one in self._named(message.epoch) if (one.number, one.digest) == named), None)
                if epoch is not None:
                    self.epochs[epoch.number] = self.current = self._prepared[epoch.number & 0xFF] = epoch
                    if epoch.activated_ns is None:
                        epoch.activated_ns, epoch.is_adopted = t_ns, message.term > epoch.term
        if epoch is None or epoch.configuration is not None or epoch.flaw:
            return None
        if self.epochs.get(epoch.number) is not epoch:  # another epoch of this number may have run before
            return None
        return self._put_together(epoch)

    def fits(self, message: Activate | Lease) -> bool:
        """Tell whether a command names an epoch whose slices were all sent, and are slices of this spec."""
        named = (one for one in self._named(message.epoch) if one.digest == message.digest)
        epoch = next((one for one in named if one.number == message.epoch), None)
        if epoch is None:
            return False
        slices = {pe.node_id: b"" for pe in self._spec.pes.values()}
        for node, head in epoch.heads.items():
            body = self._bytes.get((node, head.length, head.digest))
            if body is None:
                return False
            slices[node] = body
        return configuration_digest(self._identities, slices) == epoch.digest

    def digests(self, page: StatePage1) -> list[int]:
        """Return the digests of all known epochs with the number that a page 1 names."""
        return [epoch.digest for epoch in self._named(page.staged_epoch)]

    def staged(self, node: int, page: StatePage1) -> None:
        """Read a page 1, in which a PE reports the epoch that it has staged."""
        for epoch in self._named(page.staged_epoch):
            if (page.staged_epoch, page.staged_digest) == (epoch.number, epoch.digest):
                epoch.staged.add(node)

    def _named(self, number: int) -> list[Epoch]:
        """Return the epochs with this number; the epoch that the active manager prepared comes first."""
        known = (self._prepared.get(number & 0xFF), self._apart.get(number & 0xFF), self.epochs.get(number))
        return [epoch for epoch in known if epoch is not None]

    def _put_together(self, epoch: Epoch) -> Epoch | None:
        """Set the configuration of an activated epoch, or its flaw, and return the epoch.

        While bytes that are still missing may come, do nothing and return None.
        """
        slices = {pe.node_id: self._called(epoch, pe.node_id) for pe in self._spec.pes.values()}
        for node, head in epoch.heads.items():
            if (body := self._bytes.get((node, head.length, head.digest))) is not None:
                slices[node] = body
            elif node not in self._wired:
                return None
            else:
                epoch.flaw = f"it was activated before the slice of node {node} was sent"
        is_whole = configuration_digest(self._identities, slices) == epoch.digest
        if not is_whole and slices.keys() - epoch.heads.keys() - self._wired:
            return None  # the head for a PE beyond a radio may still come
        try:
            if epoch.flaw is None and not is_whole:
                epoch.flaw = "the slices that were sent do not have the digest that PREPARE has announced"
            if epoch.flaw is None:
                decoded = {node: decode_slice(body, self._leaves) for node, body in slices.items()}
                epoch.configuration = self._configuration(decoded)
        except (SliceError, LookupError) as error:
            epoch.flaw = f"its slices make no configuration: {error}"
        return epoch

    def _called(self, epoch: Epoch, node: int) -> bytes:
        """Return the slice that a node has on board for the contingency of the epoch; empty if it has none."""
        held = self._on_board.get(node, ())[: epoch.contingency][epoch.contingency - 1 :] if epoch.contingency else ()
        return next((one.slice for one in held if one.digest == epoch.digest), b"")

    def _keep(self, head: SliceHead | None, frames: dict[int, bytes]) -> None:
        """Keep the bytes of a slice if all its frames were sent, and if the bytes have the digest that `head` names.

        head: None: nothing is kept.
        frames: the bytes that each frame after the head carries, by the number of the frame, from 1.
        """
        count = 0 if head is None else -(-head.length // SLICE_BYTES_PER_FRAME)
        if head is not None and all(index in frames for index in range(1, count + 1)):
            body = b"".join(frames[index] for index in range(1, count + 1))[: head.length]
            identity = self._identities.get(head.node, b"")
            if slice_digest(identity, body) == head.digest:
                self._bytes[head.node, head.length, head.digest] = body

    def _configuration(self, slices: dict[int, Slice]) -> Configuration:
        modes = {
            self._modules[one.module].name: list(self._modules[one.module].modes.values())[one.mode]
            for part in slices.values()
            for one in part.modules
        }
        running = {}
        for node, part in slices.items():
            for one in part.modules:
                module = self._modules[one.module]
                mode = modes[module.name]
                inputs = {}
                for (path, _), source in zip(mode.leaves(), one.sources, strict=True):
                    if source is not None:
                        producer, variable = self._sources[source]
                        inputs[path] = Wire(producer, variable, modes[producer].gives[variable])
                running[module.name] = Running(self._pe_of_node[node], mode.name, inputs)
        return Configuration({name: running[name] for name in self._spec.modules if name in running})
