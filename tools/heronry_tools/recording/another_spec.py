"""Detects that a recording was made with another spec.

Two facts show which spec was flown:

- The digest of a slice covers the identity of the table that was compiled from the spec. If all bytes of a slice were
  sent, the digest can be checked.
- If PREPARE names a contingency by its number, one of the contingencies on board must have the digest in this PREPARE.

If one check succeeds, or if no check is possible, the mastership counts as flown with this spec. If all checks fail,
no part of the mastership is replayed, and the first failed check is reported as the reason.
"""

from collections.abc import Iterable, Iterator

from heronry_dg.model import Spec
from heronry_manager.core.tables import Compiler
from heronry_tools.recording.masterships import RecordedMastership
from heronry_wire.configuration_slice import slice_digest
from heronry_wire.management import SLICE_BYTES_PER_FRAME, Prepare, SliceBody, SliceHead, decode_command
from heronry_wire.pe_table import PeTable


def of_another_spec(spec: Spec, mastership: RecordedMastership, on_board: Iterable[PeTable] | None) -> str | None:
    """Return a sentence if a mastership was flown with another spec; None if it may have been flown with this one.

    on_board: the tables with the contingencies. None: these are not known, so a PREPARE that names a contingency only
    by its number is no evidence of another spec.
    """
    called = None if on_board is None else {one.digest for table in on_board for one in table.preloaded()}
    clues = list(_clues(spec, mastership, called))
    if not clues or any(fits for _, fits in clues):
        return None
    prepared, _ = clues[0]
    name = f"epoch {prepared.epoch} ({prepared.digest:06X})"
    if prepared.contingency:
        return f"{name} is no contingency of {spec.name}: give the spec and --contingencies of the recording"
    return f"{name} is no configuration of {spec.name}: give the spec of the recording"


def _clues(spec: Spec, mastership: RecordedMastership, called: set[int] | None) -> Iterator[tuple[Prepare, bool]]:
    """Check whether a mastership was flown with `spec`, at each point at which the frames allow a check.

    Yields, for each check, the PREPARE of the epoch that is checked, and whether the check succeeds.

    called: digests of the contingencies on board; None: these are not known, so a PREPARE that names a
        contingency by its number is not checked.
    """
    identities = Compiler(spec).identities
    prepared: Prepare | None = None
    heads: dict[int, SliceHead] = {}
    bodies: dict[int, dict[int, bytes]] = {}
    for _, command, frame in mastership.said:
        message = decode_command(command, frame.data)
        match message:
            case Prepare() if message != prepared:
                prepared, heads, bodies = message, {}, {}
                if message.contingency and called is not None:
                    yield message, message.digest in called
            case SliceHead(node=node):
                heads[node] = message
            case SliceBody(node=node):
                bodies.setdefault(node, {})[message.index] = message.body
                body = _whole(heads.get(node), bodies[node])
                if body is not None and prepared is not None:
                    yield prepared, node in identities and slice_digest(identities[node], body) == heads[node].digest


def _whole(head: SliceHead | None, frames: dict[int, bytes]) -> bytes | None:
    """Return the bytes of a slice; None while some bytes are missing.

    head: the first frame of the slice.
    frames: the bytes in each of the other frames, by the number of the frame, from 1.
    """
    count = 0 if head is None else -(-head.length // SLICE_BYTES_PER_FRAME)
    if head is None or not all(index in frames for index in range(1, count + 1)):
        return None
    return b"".join(frames[index] for index in range(1, count + 1))[: head.length]
