"""The configuration that another manager has activated, put together from the slices in its frames.

    PREPARE               begins an epoch
    SLICE with a head     names a PE that has a slice in the epoch, and the digest of the slice
    SLICE with a body     brings bytes of a new slice
    ACTIVATE or LEASE     shows that the epoch runs

The other manager does not send a slice again that has not changed. So this manager keeps every slice that it has heard,
and every slice of the running configuration, by digest, as long as there is room. The configuration that it puts
together counts only if its digest is the one in PREPARE. If a body was missed, or was sent before this manager
listened, the configuration is not known. If this manager then takes over, it makes a new plan.

PREPARE may refer to a contingency by its number (protocol rule 5). Then no slice is sent, and this manager looks the
contingency up in its own file. The contingency counts only if its digest is the one in PREPARE; another digest means
that the other manager uses another file.
"""

from collections import OrderedDict
from collections.abc import Mapping

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.core.memory import Runs
from heronry_manager.core.tables import Compiler, ContingencyNumbers
from heronry_manager.core.turn import Turn
from heronry_wire.configuration_slice import SliceError, decode_slice, slice_digest
from heronry_wire.management import (
    NO_EPOCH,
    SLICE_BYTES_PER_FRAME,
    Activate,
    Lease,
    ManagementMessage,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)

_SLICES_KEPT = 512


class Overheard:
    """Listens to the commands of the active manager, and puts its configuration together from the slices in them."""

    def __init__(self, spec: Spec, turn: Turn, compiler: Compiler, on_board: ContingencyNumbers | None = None) -> None:
        """Begin without slices.

        compiler: that of `spec`.
        on_board: the configurations that PREPARE can name by number; None: there are none.
        """
        self._spec, self._turn, self._on_board = spec, turn, on_board
        self._compiler, self._code = compiler, ConfigurationCode(spec)
        self._names = _Names(spec)
        self._known: OrderedDict[int, bytes] = OrderedDict()  # slices by digest
        self._prepared: Prepare | None = None
        self._heads: dict[int, SliceHead] = {}
        self._bodies: dict[int, dict[int, bytes]] = {}
        self._activated_as = NO_EPOCH, 0  # epoch and digest, whether its configuration is known or not
        self.runs = turn.memory.runs
        if self.runs is not None:
            self.know(self._code.decode(bytes.fromhex(self.runs.row)))

    def take(self, message: ManagementMessage) -> None:
        """Note a command of the active manager: PREPARE, SLICE, ACTIVATE or LEASE; others have no effect."""
        prepared = self._prepared
        match message:
            case Prepare(_, epoch, digest) if (epoch, digest) == self._activated_as:
                pass  # for a late PE in the running epoch, while the next epoch may be prepared
            case Prepare() if prepared is None or (prepared.epoch, prepared.digest) != (message.epoch, message.digest):
                self._prepared, self._heads, self._bodies = message, {}, {}
            case SliceHead(node, epoch_low) if prepared is not None and epoch_low == prepared.epoch & 0xFF:
                self._heads[node] = message
                self._collect(node)
            case SliceBody(node, epoch_low, index, body) if prepared is not None and epoch_low == prepared.epoch & 0xFF:
                self._bodies.setdefault(node, {})[index] = body
                self._collect(node)
            case Activate(_, epoch, step, digest) | Lease(_, epoch, step, digest) if step is not Step.PREPARED:
                self._activated_as = epoch, digest
                if prepared is not None and (prepared.epoch, prepared.digest) == (epoch, digest):
                    self._activated(epoch, digest)
            case _:
                pass

    @property
    def preparation(self) -> list[ManagementMessage]:
        """The PREPARE that was heard last, and the slices that have come for it."""
        if self._prepared is None:
            return []
        low = self._prepared.epoch & 0xFF
        bodies = (
            SliceBody(node, low, index, body) for node, parts in self._bodies.items() for index, body in parts.items()
        )
        return [self._prepared, *self._heads.values(), *bodies]

    def _collect(self, node: int) -> None:
        head, frames = self._heads.get(node), self._bodies.get(node, {})
        if head is None or head.digest in self._known:
            return
        count = -(-head.length // SLICE_BYTES_PER_FRAME)
        if all(index in frames for index in range(1, count + 1)):
            body = b"".join(frames[index] for index in range(1, count + 1))[: head.length]
            identity = self._compiler.identities.get(node)  # None: a node of another spec, or of nobody
            if identity is not None and slice_digest(identity, body) == head.digest:
                self._keep(head.digest, body)

    def _keep(self, digest: int, body: bytes) -> None:
        self._known[digest] = body
        if len(self._known) > _SLICES_KEPT:
            self._known.popitem(last=False)

    def _activated(self, epoch: int, digest: int) -> None:
        if self.runs is not None and (self.runs.epoch, self.runs.digest) == (epoch, digest):
            return
        configuration = self._called(digest) or self._put_together()
        if configuration is not None and self.know(configuration) == digest:
            self.runs = Runs(epoch, digest, self._code.encode(configuration).hex())
            self._turn.keep(self.runs)

    def _called(self, digest: int) -> Configuration | None:
        """Return the contingency whose number is in the overheard PREPARE.

        None: PREPARE has no such number, or this manager's contingency with that number has another digest.
        """
        if self._on_board is None or self._prepared is None:
            return None
        called = self._on_board.configuration(self._prepared.contingency)
        return called if called is not None and self._compiler.configuration(called).digest == digest else None

    def _put_together(self) -> Configuration | None:
        """Return the configuration that the slices of the overheard epoch make together.

        None: a slice is not known, or the slices do not fit this spec.
        """
        if any(head.digest not in self._known for head in self._heads.values()):
            return None
        try:
            return self._names.configuration({node: self._known[head.digest] for node, head in self._heads.items()})
        except (SliceError, LookupError):
            return None

    def know(self, configuration: Configuration) -> int:
        """Keep every slice of a configuration, so that these slices need not be heard later.

        Gives the digest of the configuration.
        """
        compiled = self._compiler.configuration(configuration)
        for node, body in compiled.slices.items():
            self._keep(compiled.slice_digests[node], body)
        return compiled.digest


class _Names:
    """Turns the indices in slices back into names; the reverse of `compilation`."""

    def __init__(self, spec: Spec) -> None:
        self._modules, self._sources = list(spec.modules.values()), list(spec.sources())
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._leaves = {
            (i, j): sum(1 for _ in mode.leaves())
            for i, module in enumerate(self._modules)
            for j, mode in enumerate(module.modes.values())
        }

    def configuration(self, bodies: Mapping[int, bytes]) -> Configuration:
        """Make a configuration of the slices of all nodes; `bodies` has the bytes of each slice by node-ID.

        Raises SliceError or LookupError if a slice does not fit this spec.
        """
        slices = {node: decode_slice(body, self._leaves) for node, body in bodies.items()}
        modes = {
            one.module: list(self._modules[one.module].modes.values())[one.mode]
            for part in slices.values()
            for one in part.modules
        }
        gives = {self._modules[index].name: mode.gives for index, mode in modes.items()}
        return Configuration(
            {
                self._modules[one.module].name: Running(
                    self._pe_of_node[node],
                    modes[one.module].name,
                    {
                        path: Wire(*self._sources[source], gives[self._sources[source][0]][self._sources[source][1]])
                        for (path, _), source in zip(modes[one.module].leaves(), one.sources, strict=True)
                        if source is not None
                    },
                )
                for node, part in slices.items()
                for one in part.modules
            }
        )
