"""Reads from PEs by SDO the spec and the protocol of their tables, and assesses the answers.

canopen, which reads them, is an optional package.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.canopen_log import keep_off_the_terminal
from heronry_tools.runtime.doctor.expected import Expected
from heronry_wire.canopen_objects import SPEC
from heronry_wire.protocol_version import PROTOCOL, Version
from heronry_wire.sdo import read_number

if TYPE_CHECKING:
    from heronry_wire.bare_can import can

_ANSWER_WITHIN_S = 1.0
_TRIES = 2  # a request of the manager takes the place of another client's transfer
_DIGEST_SUB, _VERSION_SUB = 3, 4  # sub-indices in the CANopen object SPEC
_INSTALL_CANOPEN = 'pip install "heronry[doctor]"'


@dataclass(frozen=True, slots=True)
class ToldTable:
    """What a PE tells of its table: the digest of its spec, and the version of the protocol that the PE speaks."""

    digest: str
    version: Version = PROTOCOL

    def is_of(self, digest: str) -> bool:
        """Tell whether this PE can work with a manager of this software that flies the spec with this digest."""
        return self.version.major == PROTOCOL.major and self.digest == digest


Answers = Mapping[int, ToldTable | None]
"""By node-ID; None if the node does not answer."""


def ask_tables(bus: "can.BusABC", nodes: Iterable[int]) -> Answers | None:
    """Read from each PE what it tells of its table. If any PE is asked, the bus is closed afterwards.

    If there are nodes to ask, and canopen is not installed, returns None instead of the answers.
    """
    asked = sorted(nodes)
    if not asked:
        return {}
    try:
        import canopen  # noqa: PLC0415 - slow to import
        from canopen.sdo.exceptions import SdoError  # noqa: PLC0415 - as above
    except ModuleNotFoundError:
        return None
    keep_off_the_terminal()
    told: dict[int, ToldTable | None] = dict.fromkeys(asked)
    with canopen.Network(bus) as network:
        network.connect()
        for node in asked * _TRIES:
            if told[node] is not None:
                continue
            sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
            sdo.RESPONSE_TIMEOUT = _ANSWER_WITHIN_S
            with suppress(SdoError):
                digest = sdo.upload(SPEC, _DIGEST_SUB).decode("ascii", "replace")
                version = read_number(sdo.upload(SPEC, _VERSION_SUB))
                told[node] = None if version is None else ToldTable(digest, Version.of_number(version))
    return told


def assess_tables(answers: Answers | None, expected: Expected | None) -> Iterator[Finding]:
    """Yield findings about the tables of PEs.

    answers: of the PEs that were asked; None: they cannot be asked.
    expected: has the right digest, and the names of PEs; None: all digests are compared with the first that is known.
    """
    if answers is None:
        yield Finding("tables", "the specs of the PEs are unknown: canopen is not installed", _INSTALL_CANOPEN)
        return
    names = {} if expected is None else expected.pes
    silent = [_named(node, names) for node, told in answers.items() if told is None]
    if silent:
        yield Finding("tables", f"no answer by SDO from {', '.join(silent)}", "repeat on an idle bus")
    known = {node: told for node, told in answers.items() if told is not None}
    foreign = {node: told for node, told in known.items() if told.version.major != PROTOCOL.major}
    for node, told in foreign.items():
        says = f"{_named(node, names)} speaks protocol {told.version}, and this computer {PROTOCOL}"
        remedy = "pip install heronry   (the same major version on both; then a new table for the PE)"
        yield Finding("protocol", says, remedy)
    wanted = expected.digest if expected is not None else next((told.digest for told in known.values()), "")
    wrong = [_named(node, names) for node, told in known.items() if told.digest != wanted and node not in foreign]
    if wrong:
        other = expected.spec if expected is not None else f"node {next(iter(known))}"
        remedy = "heronry table SPEC PE -o PE.table   (on the manager's computer; copy it there and restart the agent)"
        verb = "has a table" if len(wrong) == 1 else "have tables"
        yield Finding("tables", f"{', '.join(wrong)} {verb} of another spec than {other}", remedy)
    elif known and not foreign:
        yield Finding(
            "tables", f"all {len(known)} PEs have tables of one spec (digest {wanted[:8]}), protocol {PROTOCOL}"
        )


def _named(node: int, names: Mapping[int, str]) -> str:
    return f"{names[node]} ({node})" if node in names else f"node {node}"
