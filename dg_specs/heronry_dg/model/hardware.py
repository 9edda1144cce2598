"""What there is to fly with: buses, PEs, devices, and the parts of the physical world that they see and move."""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, Literal

from heronry_dg.field_types import (
    Capacity,
    Criticality,
    DriverName,
    IdentifierRange,
    Labels,
    Names,
    NumberRange,
    Options,
    Period,
    PositiveMemory,
    PositiveNumber,
    SafeAction,
    Share,
)
from heronry_dg.keys import Bounds, Key
from heronry_dg.model.fallible import Fallible
from heronry_wire.frame import MAX_DATA_BYTES
from heronry_wire.identifiers import FIRST_PE, LAST_PE
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS, USUAL_MISSES
from heronry_wire.timing import worst_bits

LAST_11_BIT_ID = (1 << 11) - 1
LAST_29_BIT_ID = (1 << 29) - 1
_LOWER_BITS = 18  # of a 29-bit identifier


@dataclass(frozen=True, slots=True)
class Foreign:
    """Frames of other equipment on a bus: one frame in each period, under any identifier of a range.

    Its priority is that of the smallest identifier.
    """

    identifier: Annotated[
        int | None,
        Bounds(ge=0, le=LAST_29_BIT_ID),
        Key("Identifier of the frames; at most 2047 if `extended` is false.", 1793, left_out=None),
    ]
    span: Annotated[
        IdentifierRange | None,
        Key(
            "First and last identifier, instead of `identifier`, if one sender uses several; the first one counts in "
            "arbitration.",
            [1800, 1815],
            called="range",
            left_out=None,
        ),
    ]
    extended: Annotated[bool, Key("Whether the identifiers have 29 bits, and not 11.", True, left_out=False)]
    data_bytes: Annotated[
        int, Bounds(ge=0, le=MAX_DATA_BYTES), Key("Number of data bytes of the longest frame.", 8, called="bytes")
    ]
    period_ns: Annotated[
        Period, Key("Shortest time in ms from one of these frames to the next.", 10, called="period_ms")
    ]

    @property
    def first(self) -> int:
        """The smallest identifier."""
        return self.span[0] if self.span is not None else self.identifier or 0

    @property
    def last(self) -> int:
        """The largest identifier."""
        return self.span[1] if self.span is not None else self.identifier or 0

    @property
    def bits(self) -> int:
        """Length of the longest frame in bits, with its intermission."""
        return worst_bits(self.data_bytes, extended=self.extended)

    def outranks(self, identifier: int) -> bool:
        """Tell whether a frame may win the bus against a data frame with this 11-bit identifier.

        A 29-bit frame sends the upper 11 bits of its identifier first. If they are equal, the 11-bit frame wins.
        """
        return self.first >> _LOWER_BITS < identifier if self.extended else self.first <= identifier


@dataclass(frozen=True, slots=True)
class Bus(Fallible):
    """One CAN segment."""

    name: str
    bitrate: Annotated[int, Bounds(gt=0, le=1_000_000_000), Key("Bit rate in bit/s.", 1000000)]
    max_load: Annotated[
        Share, Key("Largest share of the bit rate that may be used; 0.8 is the CANaerospace rule.", 0.8)
    ] = Fraction(8, 10)
    reserve: Annotated[
        Share, Key("Share of the bit rate kept for management; data may use max_load - reserve.", 0.1)
    ] = Fraction(1, 10)
    kind: Annotated[
        Literal["wired", "wireless"],
        Key("Whether the bus is wired; on a wireless bus only bandwidth is checked, and not response times.", "wired"),
    ] = "wired"
    channels: Annotated[
        int,
        Bounds(ge=1, le=2),
        Key("Number of channels; with 2 the bus is replicated: every frame is sent on both.", 1),
    ] = 1
    heartbeat_ns: Annotated[
        Period, Key("Period in ms of each PE's state frame on this bus.", 20, 12.5, called="heartbeat_ms")
    ] = USUAL_HEARTBEAT_NS
    misses: Annotated[
        int,
        Bounds(ge=1, le=255),
        Key("Number of heartbeat periods without a state after which a PE counts as down.", 3),
    ] = USUAL_MISSES
    foreign: Annotated[
        tuple[Foreign, ...],
        Key(
            "Frames that other equipment sends on this bus; loads and response times count them.",
            [{"identifier": 1793, "bytes": 8, "period_ms": 10}],
        ),
    ] = ()


@dataclass(frozen=True, slots=True)
class Manager:
    """The bus of the managers, and what PEs do while they hear no manager."""

    bus: Annotated[str, Key("Bus of the managers; the first wired bus if left out.", "can0", resolved="")]
    without_manager: Annotated[
        Literal["keep", "safe_mode"],
        Key(
            "What PEs do while they hear no manager: keep all modules, or stop those serving nothing critical.", "keep"
        ),
    ] = "keep"


@dataclass(frozen=True, slots=True)
class Pe(Fallible):
    """A processing element; on two or more buses it is a gateway."""

    name: str
    node_id: Annotated[int, Bounds(ge=FIRST_PE, le=LAST_PE), Key("CANaerospace and CANopen node-ID.", 92)]
    buses: Annotated[
        Names, Bounds(min_length=1), Key("Buses of the PE; with two or more the PE is a gateway.", ["can0"])
    ]
    cpu_millis: Annotated[
        Capacity, Key("CPU capacity that modules may use, in reference cores.", 0.5, called="cpu")
    ]  # thousandths of a reference core
    ram: Annotated[PositiveMemory, Key("RAM that modules may use.", "32KiB")]
    flash: Annotated[PositiveMemory, Key("Flash that modules may use.", "64KiB")]
    features: Annotated[Labels, Key("Labels that a module may require.", ["fpu"])] = frozenset()
    table_bytes: Annotated[
        PositiveMemory, Key("Memory for the PE's table, with modules and contingencies.", "4KiB")
    ] = 4096


@dataclass(frozen=True, slots=True)
class Device(Fallible):
    """A sensor or an actuator, connected to one PE."""

    name: str
    kind: Annotated[
        Literal["sensor", "actuator"],
        Key("Whether the device gives data (sensor) or takes data (actuator).", "sensor"),
    ]
    pe: Annotated[str, Key("PE to which the device is connected.", "tail_pe")]
    driver: Annotated[
        DriverName | None,
        Key("Driver of the real device: a shipped one, an entry point, or `package.module:Class`.", "bmp280"),
    ] = None
    options: Annotated[Options, Key("The driver's own options.", {"bus": 1})] = field(default_factory=dict)
    stale_ns: Annotated[
        Period | None,
        Key(
            "Age in ms from which a reading of a sensor is not valid; 5 periods of the fastest module on it if left "
            "out.",
            100,
            called="stale_ms",
        ),
    ] = None
    span: Annotated[
        NumberRange | None,
        Key(
            "Least and largest valid reading of a sensor; a reading outside is not valid.", [300, 1100], called="range"
        ),
    ] = None
    limits: Annotated[
        NumberRange | None, Key("Least and largest command of an actuator; a command outside is clipped.", [-25, 25])
    ] = None
    rate_limit: Annotated[
        PositiveNumber | None, Key("Fastest movement of an actuator, in units of its command per second.", 60)
    ] = None
    safe: Annotated[
        SafeAction | None,
        Key(
            "What an actuator does while no command is valid: `hold`, `release` or a value; `release` if left out, or "
            "`hold` if its driver cannot release.",
            "release",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Plant:
    """A part of the physical world that is controlled.

    What is controlled on several axes is written as several plants.
    """

    name: str
    moved_by: Annotated[Names, Key("Actuators that act on the plant.", ["elevator_servo"])] = ()
    seen_by: Annotated[Names, Key("Sensors that measure the plant.", ["pitch_gyro"])] = ()
    affects: Annotated[Names, Key("Other plants on which this plant acts.", ["altitude"])] = ()
    criticality: Annotated[
        Criticality, Key("How bad it is to lose control of the plant: A (worst) to E (not critical).", "A")
    ] = "E"
