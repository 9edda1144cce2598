"""The kinds of faults that can be injected, and `Fault`: one injected fault, one line of a scenario.

`KINDS` gives for each kind:

- its possible targets
- its duration in milliseconds (0: it does not end)
- the rules of the oracles that are not *promised*: the oracles do not check them while such a fault is present

As text a fault is

    SECONDS KIND ELEMENT [for SECONDS] [in STATE] [level NUMBER]     2.013 pause pe:nav for 0.3 in preparing

The first SECONDS count from the moment at which the first configuration runs; those after `for` are the duration. A
fault with a state waits, up to `WAITS_MS`, until the protocol is in this state (`protocol_state`). In the example, PE
`nav` is paused for 0.3 s, 2.013 s after the start or later, as soon as the protocol is in the state `preparing`.

What is promised, what is not, and why:

- `corrupt`, `wrong` and `bias`: data are not authenticated, so a module that reads a wrong number may report a healthy
  element (rule `blame` is not promised). During `corrupt`, rule `foreign` is not promised either: it compares the
  inputs of modules with the frames that were sent, and the altered data were not sent. No PE takes data as a command,
  so every other rule is promised.
- `forge` alters a management frame in a way that the CRC does not show (about one of 10^10 destroyed frames). Without a
  key a forged command is a valid command, so nothing is promised until the fault is over. Afterwards the aircraft must
  converge, unless a forged term was far higher than all others: then the PEs refuse the commands of all managers for a
  long time. So `forge` is not drawn for a flight without a key. With a key everything is promised.
- `attack` is injected only in flights with a key. Everything is promised, with one exception (rule `copies`): on a
  replicated bus the attacker may repeat a frame of one channel exactly on the other channel; this frame is taken for a
  copy.
- `forged_...` (`denial`) are injected only in flights with a key. The same is promised as for `attack`. Besides, if the
  forged frames take less than a tenth of the bus, no function may fall silent because of them, and no PE may lose its
  session (oracle `availability`).
- `babble`: a node whose identifier wins every arbitration sends without end, so no other node can send, and no function
  is served. One rule is still promised: since no PE hears another node, no PE may drive anything exclusive.
- `rogue`: a foreign node sends under an identifier of the aircraft. It collides with the owner of this identifier until
  the controllers are bus-off. This clash is no violation; everything else is promised.
- `twin`: a second node has a PE's node-ID. The manager takes the second node for this PE, and concludes that the PE has
  been restarted. The PE gives up everything exclusive as soon as it hears the second node. The two nodes destroy each
  other's frames until their controllers are bus-off.
- `raise` and `unfit` make a module fail, also after a restart, until its PE gives the module up. If the module drove an
  actuator, a monitor that does not know which module drives this actuator may report the idle actuator as stuck.
- `silent`: a module is stepped and gives nothing, like a driver whose device gives nothing. Its PE and those of its
  readers must tell so (oracle `stale`). A module with `silent: fails` counts as failed on this PE then.
- No kind of fault has an actuator as its target: without a monitor no node can know whether a surface moves.
- `manager_cut`, `manager_deaf`, `manager_loose`: a manager that hears no PE loses some PEs before the others, and plans
  without them, although they are healthy. So a function may fall silent, and rule `silence` is not promised. (When the
  manager has lost all PEs, it sends nothing.) The same follows from `manager_clock_jump`: all PEs seem to have been
  silent for the time of the jump.
- `bus_split`: each half continues with the managers that it has, and may drive anything exclusive, since no node can
  tell whether the other half is cut off or dead. After the repair the halves collide until the manager of the lower
  term has stopped.
- `manager_double`: two managers send under one node-ID until one hears the other. If both open an epoch with the same
  number, no PE can tell which manager's epoch it is. The two managers have separate journals, so each may also later
  use numbers that the other has used. At the start of a mastership ALIVE names only PEs that the manager has heard
  already. If the clash puts the manager bus-off at that time, a PE that ALIVE has not named yet withholds its outputs.
- `disk_full`: a manager that cannot write to its journal may use a term or an epoch a second time after a restart; with
  a key, also the numbers of its commands.
- `order_fail`: the active manager plans without a healthy element, and the oracles, too, take the element as failed. An
  actuator that is idle because of the order may be reported as stuck.
- `channel_loss` and `half_cut` take one channel of a replicated bus, from all nodes or from one PE. Everything is
  promised as long as every two nodes have a channel in common.
- `blank`: the managers bring tables in such a flight. The node counts as down until it has taken its table, and then
  as a PE that has returned.
- `other_code`: a PE has another version of a module's code than the other PEs. The module starts there as anywhere, but
  not from a state that the present version has saved, and no other PE takes a state of the other version. So only specs
  with a `checkpoint` have targets for it, and it is drawn apart from the other kinds, whose faults stay the same.
- `stuck`: a PE's modules hang while its heartbeat goes on, so its functions are not served. The PE ends the modules and
  starts them again, and gives them up if the fault lasts.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from heronry_dg.checkpoints import kept_modules
from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element, places
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.denial import DENIALS
from heronry_tools.sim.faults.protocol_state import STATES
from heronry_wire.frame import STANDARD_MASK

MANAGER = "manager"  # the active manager
EVERYTHING = "everything"  # every element that is latched, or in quarantine
MANAGERS: Mapping[str, int | None] = {MANAGER: None, "primary": 126, "standby": 127}  # node-ID; None: the active one
WAITS_MS = 3_000
"""Longest wait of a fault for its state, in ms; then it is injected whatever the state."""

_TEXT = re.compile(
    r"(?P<at>\d{1,6}(\.\d{1,3})?) (?P<kind>[a-z_]+) (?P<target>[^ ]+)"
    r"( for (?P<lasts>\d{1,6}(\.\d{1,3})?))?( in (?P<during>[a-z]+))?( level (?P<level>\d{1,9}))?",
    re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault: its targets and duration, how it is drawn, and which rules of the oracles it waives."""

    target_kind: (
        str  # pe, gateway, module, device, bus, main_bus (the manager's), far_bus (others), channel, twin_pe, manager,
        # element (that the operator may declare failed), latched, phase, place (a module on one PE), kept_place (the
        # same, of a module with a checkpoint). Where a module or an element is the target, a place may be named, too
    )
    lasts_ms: tuple[int, int]
    description: str
    for_good: float = 0.0  # share of the drawn faults that do not end
    levels: tuple[int, ...] = (0,)
    unpromised: frozenset[str] = frozenset()  # rules of the oracles that are waived while it is present
    excuses: bool = False  # a module may report a healthy element because of such a fault
    lasting: bool = False  # the waiver goes on until the end of the flight
    promised_with_key: bool = False  # in a flight with a key no rule is waived
    drawn: bool = True  # drawn where the user names no kinds; one more such kind changes the faults of every seed
    drawn_apart: bool = False  # drawn in half of the flights, with chances of its own
    of_two: bool = False  # drawn only where there are two managers
    of_keyed: bool = False  # drawn in every flight with a key, and more often than others
    needs_key: bool = False  # managers and PEs must have a key
    is_order: bool = False  # it is an order of the operator to the active manager


_COMMANDED = frozenset(
    (
        *("exclusion", "clash", "digest", "epoch", "blame", "configuration", "service"),
        *("freshness", "foreign", "publishing", "load", "mastership", "term", "policy", "transition", "phase"),
    )
)

_NUMBERED = frozenset(("mastership", "term", "digest", "journal"))

KINDS: Mapping[str, Kind] = {
    "crash": Kind("pe", (200, 3000), "a PE dies; it may be started again", for_good=0.3),
    "reboot": Kind("pe", (1, 60), "a PE restarts before the manager can miss it"),
    "brownout": Kind("pe", (300, 2500), "a PE dies and starts again and again"),
    "mute": Kind("pe", (20, 2000), "a PE's transmitter fails: the PE hears, but is not heard"),
    "deaf": Kind("pe", (20, 2000), "a PE's receiver fails: the PE is heard, but does not hear"),
    "cut": Kind("pe", (20, 2000), "the wires of a PE break"),
    "loose": Kind("pe", (50, 1500), "a PE's connector is loose: its transmitter, its receiver or both fail in turn"),
    "pause": Kind("pe", (5, 1500), "a PE's processor is paused; its CAN controller is not"),
    "slow": Kind("pe", (100, 3000), "every step of a module takes up to 8 ms"),
    "stuck": Kind("pe", (100, 2000), "the modules of a PE hang, but its heartbeat goes on"),
    "clock_jump": Kind("pe", (0, 0), "a PE's clock jumps ahead", levels=(1, 10, 70, 300)),
    "bus_off": Kind("pe", (0, 0), "a PE's controller counts too many errors and leaves the bus"),
    "bad_transmitter": Kind("pe", (1, 60), "a PE's controller destroys every frame it sends"),
    "half_cut": Kind(
        "twin_pe", (20, 3000), "a PE's wire to one channel of its bus breaks (level: which)", levels=(1, 2)
    ),
    "late": Kind(
        "gateway",
        (100, 2000),
        "frames of a gateway are sent late and out of order (level: longest delay in ms)",
        levels=(30, 90),
    ),
    "blank": Kind("pe", (200, 3000), "a PE dies, and a node without a table takes its place", drawn=False),
    "inspect": Kind(
        "pe", (5000, 30000), "a diagnostic client reads and writes objects of a PE, and makes mistakes", drawn=False
    ),
    "manager_crash": Kind(MANAGER, (100, 2000), "the manager dies and is started again"),
    "manager_pause": Kind(MANAGER, (5, 500), "the manager's processor is paused"),
    "manager_cut": Kind(
        MANAGER,
        (20, 1000),
        "the wires of a manager break, but it runs on",
        unpromised=frozenset(("silence",)),
    ),
    "manager_mute": Kind(MANAGER, (20, 1000), "a manager's transmitter fails: it hears, but is not heard"),
    "manager_deaf": Kind(
        MANAGER,
        (20, 1000),
        "a manager's receiver fails: it is heard, but does not hear",
        unpromised=frozenset(("silence",)),
    ),
    "manager_loose": Kind(
        MANAGER,
        (50, 1500),
        "a manager's connector is loose: its transmitter, its receiver or both fail in turn",
        unpromised=frozenset(("silence",)),
    ),
    "manager_power": Kind(
        MANAGER, (100, 2000), "a manager loses power, and a write to its disk is torn", drawn=False, of_two=True
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
        "a second manager starts elsewhere with the same node-ID and journal (level 1: without --standby)",
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
    "omission": Kind("bus", (100, 3000), "a receiver misses frames (level: per mille)", levels=(1, 10, 100)),
    "doubled": Kind("bus", (100, 3000), "a receiver gets frames twice (level: per mille)", levels=(1, 10, 100)),
    "burst": Kind("bus", (1, 30), "every frame is destroyed"),
    "collapse": Kind("far_bus", (100, 2000), "bits take longer (level: how many times)", levels=(2, 5)),
    "link_cut": Kind("far_bus", (50, 3000), "no frame passes between a gateway and the bus beyond"),
    "link_up_only": Kind("far_bus", (50, 3000), "a gateway hears the bus beyond, but is not heard there"),
    "link_down_only": Kind("far_bus", (50, 3000), "a gateway is heard on the bus beyond, but hears nothing of it"),
    "channel_loss": Kind("channel", (100, 3000), "a channel of a replicated bus carries nothing"),
    "babble": Kind("bus", (5, 400), "a foreign node sends without end (level: its identifier)", levels=(1, 291, 1999)),
    "rogue": Kind("bus", (5, 400), "a foreign node sends under an identifier of the aircraft"),
    "twin": Kind("pe", (5, 1000), "a foreign node with a PE's node-ID reports that it has just started"),
    "corrupt": Kind(
        "bus",
        (100, 2000),
        "data are altered, and the CRC does not show it",
        unpromised=frozenset(("foreign",)),
        excuses=True,
    ),
    "forge": Kind(
        "bus",
        (20, 500),
        "commands are altered, and the CRC does not show it",
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
    **{
        name: Kind(
            "bus",
            (500, 3000),
            f"a node without the key forges {what} (level: per cent of the bus)",
            levels=(1, 3, 9),
            unpromised=frozenset(("copies",)),
            drawn=False,
            needs_key=True,
        )
        for name, what in DENIALS.items()
    },
    "raise": Kind("module", (0, 0), "a module raises an exception", for_good=1.0),
    "unfit": Kind("module", (0, 0), "a module gives a value outside its type's range", for_good=1.0),
    "wrong": Kind("module", (100, 2000), "a value of a module is wrong by 40, or in one bit", excuses=True),
    "silent": Kind(
        "module",
        (400, 3000),
        "a module gives no data (level: only this one of its outputs, from 1, is left out)",
        levels=(0, 1),
        drawn=False,
    ),
    "overrun": Kind("module", (50, 1000), "every step of a module takes 30 ms"),
    "missing": Kind("place", (0, 0), "the code of a module is missing on a PE", for_good=1.0, drawn=False),
    "other_code": Kind(
        "kept_place",
        (500, 10_000),
        "a PE has another version of a module's code, and the module runs it from its next start there on",
        drawn_apart=True,
    ),
    "dead": Kind("device", (0, 0), "a sensor does not answer", for_good=1.0),
    "bias": Kind("device", (0, 0), "a sensor is wrong by 40 of its units", for_good=1.0, excuses=True),
    "order_fail": Kind(
        "element", (200, 4000), "the operator declares an element failed, and clears it", for_good=0.2, is_order=True
    ),
    "order_storm": Kind(
        "element",
        (1500, 4000),
        "the operator fails and clears an element again and again (level: period in ms)",
        levels=(2, 12),
        drawn=False,
        is_order=True,
    ),
    "order_clear": Kind("latched", (0, 0), "the operator clears all that is latched or in quarantine", is_order=True),
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
    "order_storm": (1, 1000),
    "silent": (0, 15),
    **dict.fromkeys(DENIALS, (1, 50)),
}
"""Lowest and highest level, for the kinds that have levels."""


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """One fault: injected at `at_ms` or later, and over after `lasts_ms`.

    `lasts_ms` is 0 for a fault that does not end, and for an event without a duration, such as a clock jump.
    """

    at_ms: int
    kind: str
    target: str  # KIND:NAME (of a channel channel:BUS.N), manager, primary, standby or everything
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
        """Return the latest time in ms at which the fault is over, or at which it is injected if it has no end."""
        return self.at_ms + (WAITS_MS if self.during else 0) + self.lasts_ms

    @property
    def name(self) -> str:
        """Return the name in the target, without its kind: `nav` of `pe:nav`."""
        return self.target.partition(":")[2]


def read_fault(spec: Spec, text: str) -> Fault:
    """Read a fault from its text; raises UserError if the text is no fault or does not fit the spec."""
    match = _TEXT.fullmatch(text.strip())
    if match is None:
        raise UserError(
            f"'{text}' is not a fault; write SECONDS KIND ELEMENT, for example '2.5 pause pe:NAME for 0.3' "
            "(in a scenario: 'at 2.5s pause pe:NAME for 300ms')"
        )
    kind = KINDS.get(match["kind"])
    if kind is None:
        raise UserError(f"'{text}': there is no fault kind '{match['kind']}'; the kinds are {', '.join(KINDS)}")
    if match["during"] and match["during"] not in STATES:
        raise UserError(f"'{text}': there is no state '{match['during']}'; the states are {', '.join(STATES)}")
    targets = possible_targets(spec, match["kind"])
    if kind.target_kind in ("module", "element"):
        targets = [*targets, *_places(spec)]
    if match["target"] not in (*targets, *(MANAGERS if targets == [MANAGER] else ())):
        raise UserError(f"'{text}': {_no_target(spec, match['kind'], match['target'], targets)}")
    level = int(match["level"]) if match["level"] else kind.levels[0]
    lowest, highest = LEVELS.get(match["kind"], (0, 0))
    if not lowest <= level <= highest:
        levels = f"a level from {lowest} to {highest}, not {level}; in this fault {kind.description}"
        bounds = levels if highest else "no level; leave it out"
        raise UserError(f"'{text}': {match['kind']} has {bounds}")
    return Fault(
        _ms(match["at"]), match["kind"], match["target"], _ms(match["lasts"] or "0"), match["during"] or "", level
    )


def over_s(faults: Iterable[Fault]) -> float:
    """Return the time of the flight (s) at which the last of these faults is over; 0 without faults."""
    return max((fault.over_ms for fault in faults), default=0) / 1000


def is_one_of_two(target: str) -> bool:
    """Tell whether a target is the primary or the standby manager, which exist only in a flight with two managers."""
    return MANAGERS.get(target) is not None


def drawn_kinds(spec: Spec, *, of_two: bool, keyed: bool = False) -> list[str]:
    """Return the kinds of faults that are drawn if the user names none: those with a target in this spec.

    of_two: whether there are two managers
    keyed: whether managers and PEs have a key
    """
    drawn = [n for n, kind in KINDS.items() if kind.drawn or (of_two and kind.of_two) or (keyed and kind.of_keyed)]
    return [name for name in drawn if possible_targets(spec, name)]


def possible_targets(spec: Spec, kind: str) -> list[str]:
    """Return the targets of a kind of fault in a spec, in the spec's order."""
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
        "place": {"module": [place.removeprefix("module:") for place in _places(spec)]},
        "kept_place": {
            "module": [place.removeprefix("module:") for one in kept_modules(spec) for place in places(spec, one)]
        },
    }
    target_kind = KINDS[kind].target_kind
    if target_kind not in names:
        return [EVERYTHING if target_kind == "latched" else MANAGER]
    return [f"{kind}:{name}" for kind, there in names[target_kind].items() for name in there]


def _places(spec: Spec) -> list[str]:
    return [place for module in spec.modules for place in places(spec, module)]


def replicated_bus(spec: Spec, pe: str) -> str | None:
    """Return the first bus with two channels to which a PE is connected; None if there is no such bus."""
    return next((bus for bus in spec.pes[pe].buses if spec.buses[bus].channels > 1), None)


def _no_target(spec: Spec, kind: str, target: str, targets: list[str]) -> str:
    try:
        checked_element(spec, target)
    except UnknownElementError as error:
        return f"{error}"
    none = "this spec has no target for it; choose another kind"
    there = f"its targets are {', '.join(targets)}" if targets else none
    return f"{kind} cannot be injected into {target}; {there}"


def _ms(seconds: str) -> int:
    whole, _, fraction = seconds.partition(".")
    return 1000 * int(whole) + int(fraction.ljust(3, "0") or 0)
