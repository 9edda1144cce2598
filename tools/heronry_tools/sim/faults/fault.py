"""The kinds of faults of an aircraft, and one fault: one line of a scenario.

Every kind says what it is injected into, how long it may last (in milliseconds; 0 is "for good"), and what cannot be
promised while it is present. As text a fault is

    SECONDS KIND ELEMENT [for SECONDS] [in STATE] [level NUMBER]     2.013 pause pe:nav for 0.3 in preparing

counted from the moment at which the first configuration runs; a fault with a state waits, for a while, until the
protocol is in it (`protocol_state`).

What is not promised, and why:

- `corrupt`, `wrong` and `bias`: the data plane is not authenticated, and a module that reads a wrong number may take a
  healthy element for a failed one (blame). Data command no node, so everything else holds; but of data that were
  changed on their way no oracle can say that they were ever sent (foreign).
- `forge` changes a management frame past its CRC (one in some 10^10 frames that are destroyed at all). Without a key a
  forged command is a command: nothing holds until the fault is over, and then everything has to come right again. It
  does, unless a term was made far higher than all others: PEs accept commands of no other manager then for a long time.
  So without a key no seed draws it. With a key everything is promised.
- `attack` is injected only in flights with a key, and everything is promised there, except that on a replicated bus a
  frame is received once: a frame that is repeated to the bit, on the other channel, is a copy.
- `babble`: a node whose identifier wins every arbitration takes the bus. No function is served then; but no PE drives
  what is exclusive either, since no node is heard, and that is promised.
- `rogue`: a foreign node that sends under an identifier of the aircraft collides with its owner, down to bus-off. The
  clash with it is no violation; the rest is promised.
- `twin`: a second node under a PE's node-ID. The manager takes it for that PE, which has started anew; the PE itself
  gives up what is exclusive as soon as it hears the other node. They destroy each other's frames, down to bus-off.
- `raise` and `unfit` stop a module for good. Where it drove an actuator, a monitor that is not told which module drives
  may take the idle actuator for a stuck one, and report it.
- actuators do not fail by themselves here: whether a surface without a monitor moves, no node can know.
- `manager_cut`, `manager_deaf`, `manager_loose`: a manager that hears no PE for just so long that it loses some PEs
  and not yet the others plans without them. (A manager that has lost all of them sends nothing.) For a manager whose
  clock jumps ahead (`manager_clock_jump`) the PEs have been silent for just so long.
- `bus_split`: both halves live on, with whatever managers they have, and each may drive what is exclusive: no node can
  tell the other half from a dead one. When the wire is mended, the two collide until the lower term has given way.
- `manager_double`: two managers of one number send under one number, until one of them hears the other; where both open
  an epoch of one number no PE can tell whose epoch it takes part in. Each may take numbers that the other one has used,
  afterwards too: their journals are two. While a mastership begins it names PEs as it comes to know them; where the
  clash puts the manager off the bus then, a PE that was not named yet withholds its output.
- `disk_full`: a manager whose journal accepts no write may begin, after a restart, a term or an epoch a second time,
  and with a key count its commands in that term a second time.
- `order_fail`: the active manager plans without an element that is well, and so does the oracle. What is not driven for
  that reason may be taken for stuck. The truth is what the operator tells the active manager.
- `channel_loss` and `half_cut` take one channel of a replicated bus, from all nodes or from one PE. Everything is
  promised as long as every two nodes have a channel in common.
- `stuck`: a PE whose modules hang while its heartbeat goes on is not served. The modules are ended and begin again, and
  are given up if it lasts.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.protocol_state import STATES
from heronry_wire.frame import STANDARD_MASK

MANAGER = "manager"  # the active one
EVERYTHING = "everything"  # that is latched, or in quarantine
MANAGERS: Mapping[str, int | None] = {MANAGER: None, "primary": 126, "standby": 127}  # node-ID; None: the active one
WAITS_MS = 3_000
"""For so long a fault waits for its state; then it is injected whatever the state."""

_TEXT = re.compile(
    r"(?P<at>\d{1,6}(\.\d{1,3})?) (?P<kind>[a-z_]+) (?P<target>[^ ]+)"
    r"( for (?P<lasts>\d{1,6}(\.\d{1,3})?))?( in (?P<during>[a-z]+))?( level (?P<level>\d{1,9}))?",
    re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault."""

    target_kind: (
        str  # pe, gateway, module, device, bus, main_bus (the manager's), far_bus (others), channel, twin_pe, manager,
        # element (that the operator may fail), latched, phase
    )
    lasts_ms: tuple[int, int]
    description: str
    for_good: float = 0.0  # how often it does not end
    levels: tuple[int, ...] = (0,)
    unpromised: frozenset[str] = frozenset()  # rules of the oracles
    excuses: bool = False  # a module's report may be wrong in good faith
    lasting: bool = False  # what is not promised is not promised afterwards either
    promised_with_key: bool = False  # in a flight with a key all of it is promised
    drawn: bool = True  # also where the user names no kinds
    of_two: bool = False  # drawn only where there are two managers
    of_keyed: bool = False  # drawn only in a flight with a key
    needs_key: bool = False  # a flight in which it is injected has a key
    is_order: bool = False  # of the operator, to the active manager


_COMMANDED = frozenset(
    (
        *("exclusion", "clash", "digest", "epoch", "blame", "configuration", "service"),
        *("freshness", "foreign", "publishing", "load", "reign", "term", "policy", "transition", "phase"),
    )
)

_NUMBERED = frozenset(("reign", "term", "digest", "journal"))

KINDS: Mapping[str, Kind] = {
    "crash": Kind("pe", (200, 3000), "a PE dies, and is started again or not", for_good=0.3),
    "reboot": Kind("pe", (1, 60), "a PE restarts before the manager can miss it"),
    "brownout": Kind("pe", (300, 2500), "a PE dies and starts again and again"),
    "mute": Kind("pe", (20, 2000), "a PE's transmitter fails: it hears, and is not heard"),
    "deaf": Kind("pe", (20, 2000), "a PE's receiver fails: it is heard, and does not hear"),
    "cut": Kind("pe", (20, 2000), "the wires of a PE break"),
    "loose": Kind("pe", (50, 1500), "a PE's plug is loose: transmitter, receiver or both fail in turn"),
    "pause": Kind("pe", (5, 1500), "a PE's processor stands still; its controller goes on"),
    "slow": Kind("pe", (100, 3000), "every step of a module takes up to 8 ms"),
    "stuck": Kind("pe", (100, 2000), "modules hang, and the heartbeat goes on"),
    "clock_jump": Kind("pe", (0, 0), "a PE's clock jumps ahead", levels=(1, 10, 70, 300)),
    "bus_off": Kind("pe", (0, 0), "a PE's controller has counted too many errors, and leaves the bus"),
    "bad_transmitter": Kind("pe", (1, 60), "a PE's controller destroys every frame it sends"),
    "half_cut": Kind(
        "twin_pe", (20, 3000), "a PE's wire to one channel of its bus breaks (level: which)", levels=(1, 2)
    ),
    "late": Kind(
        "gateway",
        (100, 2000),
        "what a gateway sends is late, and out of order (level: up to so many ms)",
        levels=(30, 90),
    ),
    "inspect": Kind(
        "pe", (5000, 30000), "a diagnostic client reads and writes objects of a PE, and makes mistakes", drawn=False
    ),
    "manager_crash": Kind(MANAGER, (100, 2000), "the manager dies, and is started again"),
    "manager_pause": Kind(MANAGER, (5, 500), "the manager's processor stands still"),
    "manager_cut": Kind(
        MANAGER,
        (20, 1000),
        "the wires of a manager break, and it goes on",
        unpromised=frozenset(("silence",)),
    ),
    "manager_mute": Kind(MANAGER, (20, 1000), "a manager's transmitter fails: it hears, and is not heard"),
    "manager_deaf": Kind(
        MANAGER,
        (20, 1000),
        "a manager's receiver fails: it is heard, and does not hear",
        unpromised=frozenset(("silence",)),
    ),
    "manager_loose": Kind(
        MANAGER,
        (50, 1500),
        "a manager's plug is loose: transmitter, receiver or both fail in turn",
        unpromised=frozenset(("silence",)),
    ),
    "manager_power": Kind(
        MANAGER, (100, 2000), "a manager loses power, and what was not on its disk is torn", drawn=False, of_two=True
    ),
    "manager_clock_jump": Kind(
        MANAGER,
        (0, 0),
        "a manager's clock jumps ahead",
        levels=(10, 30, 70, 300),
        unpromised=frozenset(("silence",)),
    ),
    "manager_double": Kind(
        MANAGER,
        (100, 3000),
        "a manager is started once more elsewhere, with a copy of its journal (level 1: without --standby)",
        levels=(0, 1),
        unpromised=frozenset(("clash", "service", "silence")),
        drawn=False,
        of_two=True,
    ),
    "disk_full": Kind(
        MANAGER,
        (100, 3000),
        "a manager's disk accepts no write",
        unpromised=_NUMBERED,
        lasting=True,
        drawn=False,
        of_two=True,
    ),
    "stale_table": Kind("pe", (200, 2000), "a PE starts with the table of another spec"),
    "bus_split": Kind(
        "main_bus",
        (50, 1500),
        "the managers' bus breaks in the middle (level 1: one half still hears the other)",
        levels=(0, 1),
        unpromised=frozenset(("exclusion", "clash", "silence")),
        drawn=False,
        of_two=True,
    ),
    "loss": Kind("bus", (100, 3000), "frames are destroyed (level: per mille)", levels=(1, 10, 100)),
    "omission": Kind("bus", (100, 3000), "a receiver misses frames (per mille)", levels=(1, 10, 100)),
    "doubled": Kind("bus", (100, 3000), "a receiver gets frames twice (per mille)", levels=(1, 10, 100)),
    "burst": Kind("bus", (1, 30), "every frame is destroyed"),
    "collapse": Kind("far_bus", (100, 2000), "bits take longer (level: times)", levels=(2, 5)),
    "link_cut": Kind("far_bus", (50, 3000), "nothing passes between a gateway and the bus beyond"),
    "link_up_only": Kind("far_bus", (50, 3000), "a gateway hears the bus beyond, but is not heard there"),
    "link_down_only": Kind("far_bus", (50, 3000), "a gateway is heard on the bus beyond, but hears nothing of it"),
    "channel_loss": Kind("channel", (100, 3000), "a channel of a replicated bus carries nothing"),
    "babble": Kind("bus", (5, 400), "a foreign node sends without end (level: its identifier)", levels=(1, 291, 1999)),
    "rogue": Kind("bus", (5, 400), "a foreign node sends under an identifier of the aircraft"),
    "twin": Kind("pe", (5, 1000), "a foreign node has a PE's node-ID, and reports that it has just started"),
    "corrupt": Kind(
        "bus", (100, 2000), "data are changed past the CRC", unpromised=frozenset(("foreign",)), excuses=True
    ),
    "forge": Kind(
        "bus",
        (20, 500),
        "commands are changed past the CRC",
        unpromised=_COMMANDED,
        excuses=True,
        lasting=True,
        promised_with_key=True,
        drawn=False,
        of_keyed=True,
    ),
    "attack": Kind(
        "bus",
        (100, 3000),
        "a node without the key sends commands and reports",
        unpromised=frozenset(("copies",)),
        drawn=False,
        of_two=True,
        of_keyed=True,
        needs_key=True,
    ),
    "raise": Kind("module", (0, 0), "a module raises an exception", for_good=1.0),
    "unfit": Kind("module", (0, 0), "a module gives a value that its type cannot carry", for_good=1.0),
    "wrong": Kind("module", (100, 2000), "a value that a module gives is off by 40, or by a bit", excuses=True),
    "overrun": Kind("module", (50, 1000), "every step of a module takes 30 ms"),
    "dead": Kind("device", (0, 0), "a sensor does not answer", for_good=1.0),
    "bias": Kind("device", (0, 0), "a sensor is off by 40 of its units", for_good=1.0, excuses=True),
    "order_fail": Kind(
        "element", (200, 4000), "the operator fails an element, and clears it again", for_good=0.2, is_order=True
    ),
    "order_clear": Kind("latched", (0, 0), "the operator clears whatever is latched, or in quarantine", is_order=True),
    "order_phase": Kind("phase", (0, 0), "the operator requests another mission phase", is_order=True),
}

LEVELS: Mapping[str, tuple[int, int]] = {
    **dict.fromkeys(("clock_jump", "manager_clock_jump"), (1, 3_600_000)),
    "half_cut": (1, 2),
    "late": (1, 10_000),
    "manager_double": (0, 1),
    "bus_split": (0, 1),
    **dict.fromkeys(("loss", "omission", "doubled"), (1, 1000)),
    "collapse": (2, 100),
    "babble": (0, STANDARD_MASK),
}
"""The lowest and the highest level of the kinds that have one."""


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """One fault: not before `at_ms`, for `lasts_ms` (0: for good, or in an instant)."""

    at_ms: int
    kind: str
    target: str  # KIND:NAME, of a channel channel:BUS.N; manager, primary, standby or everything
    lasts_ms: int = 0
    during: str = ""  # one of STATES; empty: in any state
    level: int = 0

    def __str__(self) -> str:
        words = [f"{self.at_ms / 1000:.10g} {self.kind} {self.target}"]
        words += [f"for {self.lasts_ms / 1000:.10g}"] if self.lasts_ms else []
        words += [f"in {self.during}"] if self.during else []
        words += [f"level {self.level}"] if self.level or KINDS[self.kind].levels[0] else []
        return " ".join(words)

    @property
    def over_ms(self) -> int:
        """When it is over at the latest; a fault that is for good has been injected by then."""
        return self.at_ms + (WAITS_MS if self.during else 0) + self.lasts_ms

    @property
    def name(self) -> str:
        """Name of its target."""
        return self.target.partition(":")[2]


def read_fault(spec: Spec, text: str) -> Fault:
    """Read one fault; raises UserError."""
    match = _TEXT.fullmatch(text.strip())
    if match is None:
        raise UserError(f"'{text}' is no fault; write SECONDS KIND ELEMENT, for example '2.5 pause pe:NAME for 0.3'")
    kind = KINDS.get(match["kind"])
    if kind is None:
        raise UserError(f"'{text}': there is no fault '{match['kind']}'; there is {', '.join(KINDS)}")
    if match["during"] and match["during"] not in STATES:
        raise UserError(f"'{text}': there is no state '{match['during']}'; there is {', '.join(STATES)}")
    targets = possible_targets(spec, match["kind"])
    if match["target"] not in (*targets, *(MANAGERS if targets == [MANAGER] else ())):
        raise UserError(f"'{text}': {_no_target(spec, match['kind'], match['target'], targets)}")
    level = int(match["level"]) if match["level"] else kind.levels[0]
    lowest, highest = LEVELS.get(match["kind"], (0, 0))
    if not lowest <= level <= highest:
        bounds = f"a level from {lowest} to {highest}: {kind.description}" if highest else "no level; leave it out"
        raise UserError(f"'{text}': {match['kind']} has {bounds}")
    return Fault(
        _ms(match["at"]), match["kind"], match["target"], _ms(match["lasts"] or "0"), match["during"] or "", level
    )


def over_s(faults: Iterable[Fault]) -> float:
    """Give the seconds after which all of these faults are over."""
    return max((fault.over_ms for fault in faults), default=0) / 1000


def is_one_of_two(target: str) -> bool:
    """Tell whether a target names one of two managers, and so has no meaning where there is but one."""
    return MANAGERS.get(target) is not None


def drawn_kinds(spec: Spec, *, of_two: bool, keyed: bool = False) -> list[str]:
    """Kinds that a seed draws where the user names none: those that have a target.

    of_two: two managers fly. keyed: with a key.
    """
    drawn = [n for n, kind in KINDS.items() if kind.drawn or (of_two and kind.of_two) or (keyed and kind.of_keyed)]
    return [name for name in drawn if possible_targets(spec, name)]


def possible_targets(spec: Spec, kind: str) -> list[str]:
    """Targets of a kind of fault in a spec, in the spec's order."""
    pes, modules, main_bus = list(spec.pes), list(spec.modules), spec.manager.bus
    far_buses = [bus for bus in spec.buses if bus != main_bus]
    twins = [bus for bus in spec.buses.values() if bus.channels > 1]
    names: dict[str, dict[str, list[str]]] = {
        "pe": {"pe": pes},
        "gateway": {"pe": [pe for pe in pes if len(spec.pes[pe].buses) > 1]},
        "twin_pe": {"pe": [pe for pe in pes if replicated_bus(spec, pe) is not None]},
        "module": {"module": modules},
        "device": {"device": [device.name for device in spec.devices.values() if device.kind == "sensor"]},
        "bus": {"bus": list(spec.buses)},
        "main_bus": {"bus": [main_bus]},
        "far_bus": {"bus": far_buses},
        "channel": {"channel": [f"{bus.name}.{number}" for bus in twins for number in range(1, bus.channels + 1)]},
        "element": {"pe": pes, "device": list(spec.devices), "module": modules, "bus": far_buses},
        "phase": {"phase": list(spec.phases)},
    }
    target_kind = KINDS[kind].target_kind
    if target_kind not in names:
        return [EVERYTHING if target_kind == "latched" else MANAGER]
    return [f"{kind}:{name}" for kind, there in names[target_kind].items() for name in there]


def replicated_bus(spec: Spec, pe: str) -> str | None:
    """Give the first bus of a PE that has two channels; None where it has none."""
    return next((bus for bus in spec.pes[pe].buses if spec.buses[bus].channels > 1), None)


def _no_target(spec: Spec, kind: str, target: str, targets: list[str]) -> str:
    try:
        checked_element(spec, target)
    except UnknownElementError as error:
        return f"{error}"
    return f"{kind} cannot be injected into {target}; its targets are {', '.join(targets) or 'none in this spec'}"


def _ms(seconds: str) -> int:
    whole, _, fraction = seconds.partition(".")
    return 1000 * int(whole) + int(fraction.ljust(3, "0") or 0)
