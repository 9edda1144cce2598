"""A slice: one PE's part of a configuration, in as few bytes as possible.

A slice names modules, modes and *sources* by their indices in the PE's table (`pe_table`). A source is a pair
(producing module, variable) of the spec. The bytes are numbers as in `packing`, in ascending order of index, so that
equal slices have equal bytes and equal digests. Every slice has one encoding; other bytes (an index given twice, a
number longer than needed) are refused. The encoding:

    number of modules, then for each: module, mode, and for each leaf of that mode 0 (not wired) or source + 1
    number of remote sources read here, then for each: source, node-ID of its producer
    number of sources published, then for each: source, bit mask of this PE's buses
    number of sources forwarded (gateways), then for each: source, node-ID of its producer, mask of buses
    only if there are expendable modules: their number, then each; they stop while no manager is heard

The slice of a PE that runs no module and forwards nothing has no bytes: SLICE with index 0 is then enough. The digest
of a slice also covers the identity of the PE's table (`pe_table`), and with it the digest of the spec and the major of
the protocol. So a PE whose table is not the one that the manager compiled for it stages nothing.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from heronry_wire.errors import HeronryError
from heronry_wire.packing import PackingError, Unpacker, pack


@dataclass(frozen=True, slots=True)
class ModuleSlice:
    """One module to run: its index, its mode, and the source that each leaf of the mode reads (None: not wired)."""

    module: int
    mode: int
    sources: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class Slice:
    """The modules that one PE runs, and the sources that it reads, publishes and forwards."""

    modules: tuple[ModuleSlice, ...] = ()
    remote: Mapping[int, int] = field(default_factory=dict)  # source -> node-ID of its producer
    publish: Mapping[int, int] = field(default_factory=dict)  # source -> bit mask of this PE's buses
    forward: Mapping[int, tuple[int, int]] = field(default_factory=dict)  # source -> (producer's node-ID, bus mask)
    expendable: frozenset[int] = frozenset()  # modules that stop while no manager is heard (`safe_mode`)

    def encode(self) -> bytes:
        """Encode the slice as bytes; an empty slice has no bytes."""
        if self == Slice():
            return b""
        numbers = [len(self.modules)]
        for module in sorted(self.modules, key=lambda m: m.module):
            numbers += [module.module, module.mode]
            numbers += [0 if source is None else source + 1 for source in module.sources]
        for table in (self.remote, self.publish):
            numbers.append(len(table))
            numbers += [number for pair in sorted(table.items()) for number in pair]
        numbers.append(len(self.forward))
        numbers += [n for source, (node, mask) in sorted(self.forward.items()) for n in (source, node, mask)]
        if self.expendable:
            numbers += [len(self.expendable), *sorted(self.expendable)]
        return pack(numbers)

    def restricted_to(self, before: "Slice") -> "Slice":
        """Return a copy of this slice for the step BREAK.

        The copy publishes a source only on those buses on which `before` also publishes it. It forwards a source only
        onto those buses onto which `before` also forwards it from the same producer.
        """
        publish = {s: mask & before.publish.get(s, 0) for s, mask in self.publish.items()}
        forward = {
            s: (node, mask & before.forward[s][1])
            for s, (node, mask) in self.forward.items()
            if s in before.forward and node == before.forward[s][0]
        }
        return replace(
            self,
            publish={s: mask for s, mask in publish.items() if mask},
            forward={s: entry for s, entry in forward.items() if entry[1]},
        )


class SliceError(HeronryError, ValueError):
    """The bytes are not a slice for this PE; the message says why."""


def decode_slice(body: bytes, leaves: Mapping[tuple[int, int], int]) -> Slice:
    """Decode a slice; raises SliceError.

    leaves: number of leaves of each (module, mode) that the PE's table has.
    """
    if not body:
        return Slice()
    numbers = Unpacker(body)
    try:
        decoded = _read(numbers, leaves)
    except PackingError as error:
        raise SliceError(str(error)) from None
    if numbers.left():
        raise SliceError("bytes follow the last number of the slice")
    modules = {module.module for module in decoded.modules}
    if decoded.encode() != body or len(modules) != len(decoded.modules):
        raise SliceError("the slice has an index out of order or given twice, or a number in more bytes than needed")
    if not decoded.expendable <= modules:
        raise SliceError(
            f"modules {sorted(decoded.expendable - modules)} are marked as expendable, but are not in the slice"
        )
    return decoded


def _read(numbers: Unpacker, leaves: Mapping[tuple[int, int], int]) -> Slice:
    number = numbers.number
    modules = []
    for _ in range(number()):
        module, mode = number(), number()
        if (module, mode) not in leaves:
            raise SliceError(f"the table of this PE has no mode {mode} of module {module}")
        sources = tuple(number() - 1 for _ in range(leaves[module, mode]))
        modules.append(ModuleSlice(module, mode, tuple(None if s < 0 else s for s in sources)))
    remote = {number(): number() for _ in range(number())}
    publish = {number(): number() for _ in range(number())}
    forward = {number(): (number(), number()) for _ in range(number())}
    expendable = frozenset(numbers.numbers()) if numbers.left() else frozenset[int]()
    return Slice(tuple(modules), remote, publish, forward, expendable)


def slice_digest(identity: bytes, body: bytes) -> int:
    """Compute the digest (24 bits, never 0) of one PE's slice, whose bytes are `body`.

    identity: that of the PE's table.
    """
    return _digest24([identity, body])


def configuration_digest(identities: Mapping[int, bytes], slices: Mapping[int, bytes]) -> int:
    """Compute the digest (24 bits, never 0) of a whole configuration, from the bytes of all slices by node-ID.

    identities: those of the tables of these PEs, by node-ID.
    """
    heads = (bytes((node,)) + identities[node] + len(body).to_bytes(2, "big") for node, body in sorted(slices.items()))
    bodies = (body for _, body in sorted(slices.items()))
    return _digest24(part for pair in zip(heads, bodies, strict=True) for part in pair)


def _digest24(parts: Iterable[bytes]) -> int:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return int.from_bytes(digest.digest()[:3], "big") or 1
