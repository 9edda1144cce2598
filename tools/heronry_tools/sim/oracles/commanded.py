"""What the managers have commanded, read back from the frames: configurations by epoch.

PREPARE opens an epoch, SLICE heads say which PEs take part and how long each slice is, bodies bring the bytes, or the
digest of a head names bytes that were sent before, or are on board. A contingency's number stands for what the tables
have on board under it, for PEs that get no head. While a new epoch is prepared, a PE that is late for the last one is
still given that one: their commands come in turn, and each names its epoch. From the first ACTIVATE of the epoch on the
slices become a configuration again, as soon as they are all there: the manager does not wait for a PE beyond a radio,
and its slice may come later.
What a manager that is not active prepares is kept apart: no PE need follow it, and a later active manager may adopt it,
by naming in its own term what was prepared in a lower one.
Nothing here asks a manager: a slice that was never on the bus cannot be put together.
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
    """Elements in the order in which CONTROL and EMCY number them."""
    return {
        ElementKind.PE: [f"pe:{pe}" for pe in spec.pes],
        ElementKind.DEVICE: [f"device:{device}" for device in spec.devices],
        ElementKind.MODULE: [f"module:{module}" for module in spec.modules],
        ElementKind.BUS: [f"bus:{bus}" for bus in spec.buses],
    }


def _low(message: ManagementMessage) -> int:
    """Low byte of the epoch that a command is about; -1 where it is about none."""
    match message:
        case SliceHead() | SliceBody():
            return message.epoch_low
        case Prepare() | Activate() | Lease():
            return message.epoch & 0xFF
        case _:
            return -1


@dataclass(slots=True)
class Epoch:
    """One epoch as it was heard; `configuration` once it has been activated and put together."""

    number: int
    digest: int
    prepared_ns: int
    term: int  # that prepared it first
    contingency: int = 0
    heads: dict[int, SliceHead] = field(default_factory=dict)  # by node that gets a slice
    bodies: dict[int, dict[int, bytes]] = field(default_factory=dict)
    staged: set[int] = field(default_factory=set)  # nodes that have reported it
    activated_ns: int | None = None  # when that was commanded first
    is_adopted: bool = False  # by a higher term, before any other active one had activated it
    configuration: Configuration | None = None
    flaw: str | None = None  # why there is none, and will not be

    def has(self, node: int) -> bool:
        """Tell whether a node takes part: it gets a slice, or has staged what it had on board."""
        return node in self.heads or node in self.staged


class Commanded:
    """Follows the commands on the managers' bus."""

    def __init__(self, spec: Spec, tables: Iterable[PeTable] = ()) -> None:
        """`tables`: what the PEs were given, if anything on board matters."""
        self._spec = spec
        self._on_board = {table.node_id: table.preloaded() for table in tables}
        self._modules = list(spec.modules.values())
        self._sources = list(spec.sources())
        self._leaves = {
            (i, j): len(list(mode.leaves()))
            for i, module in enumerate(self._modules)
            for j, mode in enumerate(module.modes.values())
        }
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._wired = {spec.pes[pe].node_id for pe in reached_by_wire(spec)}
        # By node, length and digest, as a PE knows them: among all slices of a flight some share their 24 bits.
        self._bytes = {
            (pe.node_id, len(body), slice_digest(spec.digest, body)): body
            for pe in spec.pes.values()
            for body in {b"", *(one.slice for one in self._on_board.get(pe.node_id, ()))}
        }
        self._prepared: dict[int, Epoch] = {}  # by the low byte of the number: the last one of each
        self._apart: dict[int, Epoch] = {}  # the same, by managers that are not active
        self.epochs: dict[int, Epoch] = {}  # activated ones
        self.current: Epoch | None = None

    def take(self, t_ns: int, message: ManagementMessage, *, is_active: bool = True) -> Epoch | None:
        """Follow a command; gives an epoch once, when it has been activated and put together, or cannot be."""
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
        if self.epochs.get(epoch.number) is not epoch:  # one of that number may have run, and be another
            return None
        return self._put_together(epoch)

    def digests(self, page: StatePage1) -> list[int]:
        """Digests that a page 1 may mean: that of the epoch which it names."""
        return [epoch.digest for epoch in self._named(page.staged_epoch)]

    def staged(self, node: int, page: StatePage1) -> None:
        """Follow a page 1, which says what its PE has staged."""
        for epoch in self._named(page.staged_epoch):
            if (page.staged_epoch, page.staged_digest) == (epoch.number, epoch.digest):
                epoch.staged.add(node)

    def _named(self, number: int) -> list[Epoch]:
        """Epochs that may be meant, first that of the active manager; one that ran is known by its whole number."""
        known = (self._prepared.get(number & 0xFF), self._apart.get(number & 0xFF), self.epochs.get(number))
        return [epoch for epoch in known if epoch is not None]

    def _put_together(self, epoch: Epoch) -> Epoch | None:
        """Give an activated epoch its configuration, or its flaw; None while bytes are missing that may still come."""
        slices = {pe.node_id: self._called(epoch, pe.node_id) for pe in self._spec.pes.values()}
        for node, head in epoch.heads.items():
            if (body := self._bytes.get((node, head.length, head.digest))) is not None:
                slices[node] = body
            elif node not in self._wired:
                return None
            else:
                epoch.flaw = f"it was activated before the slice of node {node} was sent"
        is_whole = configuration_digest(self._spec.digest, slices) == epoch.digest
        if not is_whole and slices.keys() - epoch.heads.keys() - self._wired:
            return None  # a PE beyond a radio may take part that has not had its head yet
        try:
            if epoch.flaw is None and not is_whole:
                epoch.flaw = "the slices that were sent are not those of the digest that was announced"
            if epoch.flaw is None:
                decoded = {node: decode_slice(body, self._leaves) for node, body in slices.items()}
                epoch.configuration = self._configuration(decoded)
        except (SliceError, LookupError) as error:
            epoch.flaw = f"its slices make no configuration: {error}"
        return epoch

    def _called(self, epoch: Epoch, node: int) -> bytes:
        """Slice that a node has on board under the epoch's number."""
        held = self._on_board.get(node, ())[: epoch.contingency][epoch.contingency - 1 :] if epoch.contingency else ()
        return next((one.slice for one in held if one.digest == epoch.digest), b"")

    def _keep(self, head: SliceHead | None, frames: dict[int, bytes]) -> None:
        """Remember the bytes of a slice once all of them have been sent."""
        count = 0 if head is None else -(-head.length // SLICE_BYTES_PER_FRAME)
        if head is not None and all(index in frames for index in range(1, count + 1)):
            body = b"".join(frames[index] for index in range(1, count + 1))[: head.length]
            if slice_digest(self._spec.digest, body) == head.digest:
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
