"""Decodes the bytes of a slice into a slice that this PE can run, or gives the reason why it cannot.

A slice is checked before it is staged, so that its activation cannot fail half way. A slice is accepted only if

- every index is in the table,
- every wired leaf gets the variable that it reads, from a module of this slice or from a PE that the slice names,
- every published source is an output of a module of this slice,
- every bit mask names only ports of this PE,
- no two modules drive one actuator, and
- the code of every module is on this PE.
"""

from collections.abc import Iterable, Mapping

from heronry_agent.core.table_index import TableIndex
from heronry_wire.configuration_slice import ModuleSlice, Slice, SliceError, decode_slice, slice_digest
from heronry_wire.identifiers import PE_NODES
from heronry_wire.state_frames import Reason


class SliceReader:
    """Decodes and checks slices for one PE."""

    def __init__(self, index: TableIndex, missing_images: Mapping[str, str]) -> None:
        """Check slices against a table.

        missing_images: images of the table that cannot be loaded on this PE, each with the reason.
        """
        self.index = index
        self.missing_images = dict(missing_images)

    def on_board(self, number: int, digest: int) -> tuple[bytes, int] | None:
        """Return the slice of contingency `number` as bytes, and the digest of these bytes.

        Returns None if the contingency is not on board, or if `digest` is not the digest of its configuration.
        """
        body = self.index.on_board(number, digest)
        return None if body is None else (body, slice_digest(self.index.table.identity, body))

    def read(self, body: bytes, digest: int) -> Slice | Reason:
        """Decode the bytes of a slice, and check it; returns the slice, or the reason why it is refused.

        digest: digest of these bytes, as the manager has announced it.
        """
        if slice_digest(self.index.table.identity, body) != digest:
            return Reason.DIGEST
        try:
            wanted = decode_slice(body, self.index.leaf_counts)
        except SliceError:
            return Reason.UNKNOWN_INDEX
        if not self._is_coherent(wanted):
            return Reason.UNKNOWN_INDEX
        images = {self.index.modules[module.module].image for module in wanted.modules}
        return Reason.IMAGE if images & self.missing_images.keys() else wanted

    def _is_coherent(self, wanted: Slice) -> bool:
        given = {source for m in wanted.modules for source in self.index.gives(m.module, m.mode)}
        return (
            wanted.publish.keys() <= given
            and not wanted.remote.keys() & given
            and self._are_sources(wanted.remote)
            and self._are_sources(wanted.forward)
            and all(node in PE_NODES and node != self.index.node for node in wanted.remote.values())
            and all(node in PE_NODES for node, _ in wanted.forward.values())
            and all(map(self._is_mask, wanted.publish.values()))
            and all(self._is_mask(mask) for _, mask in wanted.forward.values())
            and all(self._is_wired(module, given | wanted.remote.keys()) for module in wanted.modules)
            and not self._shares_an_actuator(wanted)
        )

    def _shares_an_actuator(self, wanted: Slice) -> bool:
        """Tell whether two modules of a slice drive one actuator (semantics rule 10)."""
        driven = [self.index.modules[module.module].device for module in wanted.modules]
        driven = [device for device in driven if device in self.index.actuators]
        return len(set(driven)) < len(driven)

    def _are_sources(self, sources: Iterable[int]) -> bool:
        return all(source < len(self.index.table.sources) for source in sources)

    def _is_mask(self, mask: int) -> bool:
        return 0 < mask < 1 << len(self.index.ports)

    def _is_wired(self, module: ModuleSlice, supplied: set[int]) -> bool:
        """Tell whether every wired leaf of a module reads the leaf's own variable from a source in `supplied`.

        supplied: the sources that modules of the slice give on this PE, and those that come from other PEs.
        """
        variables = self.index.leaf_variables(module.module, module.mode)
        for variable, source in zip(variables, module.sources, strict=True):
            if source is None:
                continue
            if source not in supplied or self.index.table.sources[source].variable != variable:
                return False
        return True
