"""The contingency file: format 2.

    8 bytes   "HERONRY" and the format's number
    32 bytes  digest of the spec's file (SHA-256)
    4 bytes   length of the next part when unpacked, most significant byte first
    ...       zlib-compressed: numbers as in `heronry_wire.packing`, counts before lists
    32 bytes  SHA-256 of everything before

The numbers are, in this order:

    most faults in a set; whether places in use are planned for (1 or 0)
    the elements (indices into `situation.elements`)
    the phases (index + 1; 0 for a spec without phases)
    the configurations, as rows (`configuration_code`)
    for each phase   the number of its safe mode
                     the plans: number of the configuration, proven or not, the value as ten integers (`worth_of`)
                     for each fault set, in the order of `Scope.fault_sets`: the index of its plan
                     for each place in use: its PE, its module, the index of its plan

The file holds indices instead of names, since indices need a tenth of the room. The digest shows to which spec the
indices belong. The numbers are compressed, because the configurations of similar fault sets differ in a few modules
only. zlib and SHA-256 are in the standard library. A file with any error is not used, and the error is reported in one
sentence, with the remedy.
"""

import hashlib
import zlib
from pathlib import Path

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import elements
from heronry_manager.contingency.configuration_code import ConfigurationCode, objective_of, worth_of
from heronry_manager.contingency.contingencies import Contingencies, Made, PhasePlans
from heronry_manager.planner.sweep import Phase, Scope
from heronry_wire.errors import HeronryError
from heronry_wire.packing import PackingError, Unpacker, pack

_MAGIC = b"HERONRY"
FORMAT = 2
_HEAD_BYTES = len(_MAGIC) + 1 + 32 + 4
_DIGEST_BYTES = 32
_MOST_BYTES = 1 << 28  # unpacked; a file that claims more is not unpacked


class ContingencyFileError(HeronryError, ValueError):
    """A contingency file cannot be used; the message says why and what to do."""


def read_contingencies(file: Path, spec: Spec) -> Contingencies:
    """Read the contingency file of a spec; raises ContingencyFileError, or OSError if the file cannot be opened."""
    try:
        return from_bytes(file.read_bytes(), spec)
    except ContingencyFileError as error:
        raise ContingencyFileError(f"{file}: {error}; make it anew with 'heronry contingencies'") from None


def to_bytes(made: Contingencies, spec: Spec) -> bytes:
    """Encode contingencies as the content of a file; the same contingencies give the same bytes."""
    body = _body(made, spec)
    head = _MAGIC + bytes((FORMAT,)) + bytes.fromhex(made.spec_digest) + len(body).to_bytes(4, "big")
    content = head + zlib.compress(body, 9)
    return content + hashlib.sha256(content).digest()


def from_bytes(data: bytes, spec: Spec) -> Contingencies:
    """Decode the content of a contingency file.

    Raises ContingencyFileError if the content is damaged, or was made for another spec.
    """
    content, digest = data[:-_DIGEST_BYTES], data[-_DIGEST_BYTES:]
    if len(content) < _HEAD_BYTES or not content.startswith(_MAGIC):
        raise ContingencyFileError("the file is not a contingency file")
    if content[len(_MAGIC)] != FORMAT:
        raise ContingencyFileError(
            f"the file is of format {content[len(_MAGIC)]}, and this program reads format {FORMAT}"
        )
    if hashlib.sha256(content).digest() != digest:
        raise ContingencyFileError("the file is damaged: its checksum is wrong")
    if content[len(_MAGIC) + 1 :][:32].hex() != spec.digest:
        raise ContingencyFileError(f"the file was made for another spec, or another version of spec {spec.name}")
    try:
        return _read(Unpacker(_unpacked(content)), spec)
    except (PackingError, IndexError, ValueError, zlib.error) as error:
        raise ContingencyFileError(f"the file cannot be read ({error})") from None


def _unpacked(content: bytes) -> bytes:
    length = int.from_bytes(content[_HEAD_BYTES - 4 : _HEAD_BYTES], "big")
    if length > _MOST_BYTES:
        raise PackingError(f"the content would have {length} bytes, more than any contingency file has")
    return zlib.decompressobj().decompress(content[_HEAD_BYTES:], length)


def _body(made: Contingencies, spec: Spec) -> bytes:
    index = {element: i for i, element in enumerate(elements(spec))}
    phases = {phase: i for i, phase in enumerate(spec.phases, start=1)}
    code = ConfigurationCode(spec)
    rows = [code.encode(configuration) for configuration in made.configurations]
    parts = [
        pack([made.scope.faults, int(made.scope.places), len(made.scope.elements)]),
        pack([index[element] for element in made.scope.elements]),
        pack([len(made.phases), *(phases.get(str(table.phase), 0) for table in made.phases), len(rows)]),
        *(pack([len(row)]) + row for row in rows),
        *(_phase_body(table, spec) for table in made.phases),
    ]
    return b"".join(parts)


def _phase_body(table: PhasePlans, spec: Spec) -> bytes:
    modules, pes = list(spec.modules), list(spec.pes)
    numbers = [table.safe_mode, len(table.plans)]
    for plan in table.plans:
        numbers += [plan.number, int(plan.optimal), *worth_of(plan.objective)]
    numbers += [len(table.by_fault_set), *table.by_fault_set, 3 * len(table.by_place)]
    for place, index in table.by_place:
        module, _, pe = place.removeprefix("module:").partition("@")
        numbers += [pes.index(pe), modules.index(module), index]
    return pack(numbers)


def _read(numbers: Unpacker, spec: Spec) -> Contingencies:
    faults, places, every = numbers.number(), bool(numbers.number()), elements(spec)
    scope_elements = tuple(every[index] for index in numbers.numbers())
    names: tuple[Phase, ...] = (None, *spec.phases)
    phases = tuple(names[index] for index in numbers.numbers())
    scope = Scope(scope_elements, faults, phases, places)
    code = ConfigurationCode(spec)
    configurations = tuple(code.decode(numbers.text()) for _ in range(numbers.number()))
    tables = tuple(_read_phase(numbers, phase, scope, configurations, spec) for phase in phases)
    if numbers.left():
        raise PackingError("bytes follow the last phase of the file")
    return Contingencies(spec.digest, scope, configurations, tables)


def _read_phase(
    numbers: Unpacker, phase: Phase, scope: Scope, configurations: tuple[Configuration, ...], spec: Spec
) -> PhasePlans:
    safe_mode = _checked(numbers.number(), len(configurations))
    plans = tuple(_read_made(numbers, len(configurations)) for _ in range(numbers.number()))
    by_fault_set = tuple(numbers.numbers())
    if len(by_fault_set) != scope.set_count() or max(by_fault_set) >= len(plans):
        raise PackingError(f"phase {phase} does not have exactly one plan for each fault set")
    modules, pes, rest = list(spec.modules), list(spec.pes), tuple(numbers.numbers())
    by_place = tuple(
        (f"module:{modules[module]}@{pes[pe]}", index)
        for pe, module, index in zip(rest[::3], rest[1::3], rest[2::3], strict=True)
    )
    if any(index >= len(plans) for _, index in by_place):
        raise PackingError(
            f"phase {phase} refers to a plan for the failure of a module on a PE, but the file does not have this plan"
        )
    return PhasePlans(phase, safe_mode, plans, by_fault_set, by_place)


def _read_made(numbers: Unpacker, known: int) -> Made:
    number, optimal = _checked(numbers.number(), known), bool(numbers.number())
    return Made(number, objective_of([numbers.number() for _ in range(10)]), optimal)


def _checked(number: int, known: int) -> int:
    if not 1 <= number <= known:
        raise PackingError(f"a plan names configuration {number}, which is not one of the {known} in the file")
    return number
