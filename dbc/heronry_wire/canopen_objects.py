"""The object dictionary of a PE: one table for the server, the EDS and the documentation (CiA 301, 7.4 and 7.5).

This file lists the objects of a PE, with index and sub-index, type and access right. The agent serves exactly these
objects (`heronry_agent.core.canopen`), and `heronry_wire.eds` writes them to a file. So the table, the server and the
EDS agree.

This file keeps no state. Indices 1000h to 1FFFh are those of CiA 301 and CiA 302-3, 2000h and up are this project's
own. PDOs, SYNC and LSS have no objects here, since CANaerospace uses their identifiers on this bus (docs/protocol.md).
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from heronry_wire.identification import IDENTIFICATION
from heronry_wire.protocol_times import CANOPEN_HEARTBEAT_NS

VENDOR_ID = 0  # none is registered with CiA
PRODUCT_CODE = 0x5045  # "PE"
REVISION = IDENTIFICATION.hardware_revision << 16 | IDENTIFICATION.software_revision

DEVICE_TYPE, ERROR_REGISTER, ERROR_HISTORY = 0x1000, 0x1001, 0x1003
DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION = 0x1008, 0x1009, 0x100A
EMCY_IDENTIFIER, HEARTBEAT_TIME, IDENTITY = 0x1014, 0x1017, 0x1018
STORED_EDS, EDS_FORMAT, SDO_SERVER = 0x1021, 0x1022, 0x1200
PROGRAM_DATA, PROGRAM_CONTROL, PROGRAM_VERSION, PROGRAM_STATUS = 0x1F50, 0x1F51, 0x1F56, 0x1F57
STATE, SPEC, MASTERSHIP = 0x2000, 0x2001, 0x2002
MODULE_NAMES, MODULE_INDICES, MODULE_IMAGES, MODULE_STATES, MODULE_MODES = 0x2010, 0x2011, 0x2012, 0x2013, 0x2014
MODULE_FAILURES, MODULE_TRACEBACKS = 0x2015, 0x2016
TABLE, COUNTERS, TIME, COST, CHALLENGE, OFFER = 0x2020, 0x2021, 0x2022, 0x2023, 0x2024, 0x2025
TABLE_TRANSFER = 0x2026
PROGRAM_TRANSFER = 0x2030

ERRORS_KEPT = 8
LARGEST_INDEX = 0xFFF  # of an element, in an error of the error history
MOST_ELEMENTS = 254  # sub-indices of an array
HEARTBEAT_MS = CANOPEN_HEARTBEAT_NS // 1_000_000  # at power-on
SHORTEST_HEARTBEAT_MS = 100
BIT_RATES = (10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)  # bit/s, all of CiA 301


class Type(Enum):
    """The data types of this dictionary: code in CiA 301 (table 44), and length in bytes where it is fixed."""

    UNSIGNED8 = (0x0005, 1)
    UNSIGNED16 = (0x0006, 2)
    UNSIGNED32 = (0x0007, 4)
    VISIBLE_STRING = (0x0009, None)
    DOMAIN = (0x000F, None)

    def __init__(self, code: int, length: int | None) -> None:
        self.code = code
        self.length = length


class Access(Enum):
    """How an SDO client may access an object: read it, write it, or both."""

    CONST = "const"
    READ = "ro"
    READ_WRITE = "rw"
    WRITE = "wo"


class Kind(Enum):
    """Object codes (CiA 301, table 42)."""

    DOMAIN = 0x02
    VAR = 0x07
    ARRAY = 0x08
    RECORD = 0x09


class Variable(NamedTuple):
    """One value: an object of its own, or one sub-index of an object.

    value: the constant of a CONST; of any other variable the value at power-on. None: that value is not fixed.
    of_node: whether the server adds the node-ID to `value`.
    limits: lowest and highest number that may be written.
    """

    name: str
    type: Type
    access: Access = Access.READ
    value: int | str | None = None
    meaning: str = ""
    of_node: bool = False
    limits: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """One object of the dictionary.

    variables: for a VAR or DOMAIN, one variable; for a RECORD, those of sub-indices 1, 2, ...; for an ARRAY, one
        variable, which stands for every element.
    most: largest number of elements of an ARRAY; not used for another kind of object.
    count: the variable at sub-index 0 of an ARRAY or RECORD; None where sub-index 0 holds only the number of
        elements (ARRAY), or the highest sub-index (RECORD).
    """

    index: int
    name: str
    kind: Kind
    variables: tuple[Variable, ...]
    most: int = 0
    count: Variable | None = None
    meaning: str = ""

    def variable(self, sub_index: int) -> Variable | None:
        """Return the variable at a sub-index; None where this object has no such sub-index."""
        if self.kind in (Kind.VAR, Kind.DOMAIN):
            return self.variables[0] if sub_index == 0 else None
        if sub_index == 0:
            return self.count or self._default_count()
        if self.kind is Kind.ARRAY:
            return self.variables[0] if sub_index <= self.most else None
        return self.variables[sub_index - 1] if sub_index <= len(self.variables) else None

    def _default_count(self) -> Variable:
        if self.kind is Kind.RECORD:
            return Variable("Highest sub-index", Type.UNSIGNED8, Access.CONST, len(self.variables))
        return Variable("Number of entries", Type.UNSIGNED8)


def _var(index: int, variable: Variable) -> Entry:
    kind = Kind.DOMAIN if variable.type is Type.DOMAIN else Kind.VAR
    return Entry(index, variable.name, kind, (variable,), meaning=variable.meaning)


def _per_module(index: int, name: str, element_type: Type, meaning: str) -> Entry:
    """Make an array with one element for each module of the PE's table, in the table's order."""
    return Entry(index, name, Kind.ARRAY, (Variable(name, element_type),), MOST_ELEMENTS, meaning=meaning)


_U8, _U16, _U32, _TEXT = Type.UNSIGNED8, Type.UNSIGNED16, Type.UNSIGNED32, Type.VISIBLE_STRING
_CONST, _RW, _WO = Access.CONST, Access.READ_WRITE, Access.WRITE
_ONE_PROGRAM = Variable("Number of programs", _U8, _CONST, 1)

OBJECTS: tuple[Entry, ...] = (
    _var(DEVICE_TYPE, Variable("Device type", _U32, _CONST, 0, "no device profile of CiA")),
    _var(ERROR_REGISTER, Variable("Error register", _U8, meaning="81h while a fault told by EMCY is not cleared")),
    Entry(
        ERROR_HISTORY,
        "Pre-defined error field",
        Kind.ARRAY,
        (Variable("Standard error field", _U32),),
        ERRORS_KEPT,
        Variable("Number of errors", _U8, _RW, limits=(0, 0)),
        "newest first: code of the EMCY in bits 15..0, index of the element in 27..16, its kind in 31..28; "
        "writing 0 to sub-index 0 empties it",
    ),
    _var(DEVICE_NAME, Variable("Manufacturer device name", _TEXT, _CONST, "heronry PE")),
    _var(HARDWARE_VERSION, Variable("Manufacturer hardware version", _TEXT, _CONST, "none")),
    _var(
        SOFTWARE_VERSION,
        Variable("Manufacturer software version", _TEXT, _CONST, str(IDENTIFICATION.software_revision)),
    ),
    _var(EMCY_IDENTIFIER, Variable("COB-ID EMCY", _U32, Access.READ, 0x80, of_node=True)),
    _var(
        HEARTBEAT_TIME,
        Variable(
            "Producer heartbeat time",
            _U16,
            _RW,
            HEARTBEAT_MS,
            f"ms; 0, or {SHORTEST_HEARTBEAT_MS} and more. State frames do not depend on it",
            limits=(0, 0xFFFF),
        ),
    ),
    Entry(
        IDENTITY,
        "Identity object",
        Kind.RECORD,
        (
            Variable("Vendor-ID", _U32, _CONST, VENDOR_ID, "0: none is registered"),
            Variable("Product code", _U32, _CONST, PRODUCT_CODE),
            Variable(
                "Revision number", _U32, _CONST, REVISION, "hardware and software revision, as in the answer to IDS"
            ),
            Variable("Serial number", _U32, _CONST, 0, "0: none"),
        ),
    ),
    _var(STORED_EDS, Variable("Store EDS", Type.DOMAIN, meaning="the EDS of this node, as text")),
    _var(EDS_FORMAT, Variable("Store format", _U8, _CONST, 0, "text, not compressed")),
    Entry(
        SDO_SERVER,
        "SDO server parameter",
        Kind.RECORD,
        (
            Variable("COB-ID client to server", _U32, Access.READ, 0x600, of_node=True),
            Variable("COB-ID server to client", _U32, Access.READ, 0x580, of_node=True),
        ),
    ),
    Entry(
        PROGRAM_DATA,
        "Program data",
        Kind.ARRAY,
        (Variable("Program", Type.DOMAIN, _WO),),
        1,
        _ONE_PROGRAM,
        "a bundle of `heronry bundle`; a PE without a loader refuses a write with 0601 0000h",
    ),
    Entry(
        PROGRAM_CONTROL,
        "Program control",
        Kind.ARRAY,
        (Variable("Program state", _U8, _RW),),
        1,
        _ONE_PROGRAM,
        "1, the program runs; 0, it does not. Written: 1 starts what was written, 3 forgets it; a PE without a loader "
        "refuses a write with 0601 0000h",
    ),
    Entry(
        PROGRAM_VERSION,
        "Program software identification",
        Kind.ARRAY,
        (Variable("Program version", _U32),),
        1,
        _ONE_PROGRAM,
        "version of the bundle from which code runs; 0, none",
    ),
    Entry(
        PROGRAM_STATUS,
        "Flash status identification",
        Kind.ARRAY,
        (Variable("Flash status", _U32),),
        1,
        _ONE_PROGRAM,
        "bit 0: at work, nothing can be written now. Bits 7..1, the last error: 0 none, 1 no program, 3 damaged, "
        "5 not written to the disk, 6 too large, 7 not for this PE",
    ),
    Entry(
        STATE,
        "State of this PE",
        Kind.RECORD,
        (
            Variable("State", _U8, meaning="as in its state frames"),
            Variable("Flags", _U8, meaning="as in its state frames"),
            Variable("Incarnation", _U8),
            Variable("Running epoch", _U16),
            Variable("Running configuration digest", _U32),
            Variable("Running slice digest", _U32, meaning="of this PE's part"),
            Variable("Staged epoch", _U16),
            Variable("Staged configuration digest", _U32),
            Variable("Reason", _U8, meaning="why it has not staged"),
            Variable("Load", _U8, meaning="CPU that the spec states for what runs, in % of the CPU of this PE"),
        ),
    ),
    Entry(
        SPEC,
        "Spec of this PE",
        Kind.RECORD,
        (
            Variable("Name of this PE", _TEXT),
            Variable("Name of the spec", _TEXT),
            Variable("Digest of the spec", _TEXT, meaning="SHA-256 of what the spec means, hexadecimal"),
            Variable(
                "Version of the protocol",
                _U32,
                meaning="major in bits 31..16, minor in 15..0; it decides nothing",
            ),
        ),
    ),
    Entry(
        MASTERSHIP,
        "Manager that is obeyed",
        Kind.RECORD,
        (
            Variable("Node-ID of the manager", _U8, meaning="0: none was heard"),
            Variable("Term", _U16),
            Variable("Lease is heard", _U8, meaning="1 or 0"),
        ),
    ),
    _per_module(
        MODULE_NAMES, "Module name", _TEXT, "one element for each module that may run here, as in 2011h to 2016h"
    ),
    _per_module(
        MODULE_INDICES, "Module index", _U16, "position of the module in the spec; EMCY and slices name a module by it"
    ),
    _per_module(MODULE_IMAGES, "Module image", _TEXT, "the code"),
    _per_module(MODULE_STATES, "Module state", _U8, "0 not wanted, 1 running, 2 held, 3 failed, 4 not started yet"),
    _per_module(MODULE_MODES, "Module mode", _TEXT, "the mode that runs, or nothing"),
    _per_module(
        MODULE_FAILURES, "Module failure", _TEXT, "why the module failed last, in one line; kept until a restart"
    ),
    _per_module(MODULE_TRACEBACKS, "Module traceback", Type.DOMAIN, "of that failure, as text; its last 2000 bytes"),
    _var(
        TABLE,
        Variable(
            "Table of this PE",
            Type.DOMAIN,
            _RW,
            meaning="JSON text, as `heronry table` writes it; when written, also compressed by zlib",
        ),
    ),
    Entry(
        COUNTERS,
        "Counters",
        Kind.RECORD,
        (
            Variable("Frames not understood or not obeyed", _U32),
            Variable("Releases of modules skipped", _U32),
            Variable("Standstills of this computer", _U32, meaning="a timer came late by more than a quarter period"),
            Variable("Long standstills", _U32, meaning="those of more than a period"),
            Variable("Last long standstill", _U32, meaning="ms"),
            Variable("Longest standstill", _U32, meaning="ms"),
        ),
    ),
    Entry(
        TIME,
        "Time given by NSS",
        Kind.RECORD,
        (
            Variable("Time stamp", _U32, meaning="as it was sent (CANaerospace node service 1)"),
            Variable("Age", _U32, meaning="ms since then; FFFF FFFFh: none was heard"),
        ),
    ),
    Entry(
        COST,
        "Cost of this node in the last 10 s",
        Kind.RECORD,
        (
            Variable("Wake-ups of the agent", _U32, meaning="per second; FFFF FFFFh: not measured"),
            Variable("Processor time of the agent", _U32, meaning="per mille of a core"),
            Variable("Processor time of partitions and drivers", _U32, meaning="per mille of a core"),
            Variable("Longest turn of the agent", _U32, meaning="us"),
        ),
    ),
    _var(
        CHALLENGE,
        Variable(
            "Challenge", _U32, meaning="drawn at each start; the seal of a table covers it. 0: this node has no key"
        ),
    ),
    _var(OFFER, Variable("Offer", _TEXT, meaning="JSON text, of a node that waits for a table; else empty")),
    Entry(
        TABLE_TRANSFER,
        "Table transfer in parts",
        Kind.RECORD,
        (
            Variable(
                "Part",
                Type.DOMAIN,
                _WO,
                meaning="SHA-256 and length of what would be written into 2020h, where this part begins, the part",
            ),
            Variable("Received", Type.DOMAIN, meaning="SHA-256 of the whole, and how many bytes came in order"),
        ),
    ),
    Entry(
        PROGRAM_TRANSFER,
        "Program transfer in parts",
        Kind.RECORD,
        (
            Variable(
                "Part", Type.DOMAIN, _WO, meaning="SHA-256 and length of the bundle, where this part begins, the part"
            ),
            Variable("Received", Type.DOMAIN, meaning="SHA-256 of the bundle, and how many bytes came in order"),
            Variable("Active", Type.DOMAIN, meaning="SHA-256 of the bundle whose code runs; nothing: there is none"),
        ),
    ),
)
