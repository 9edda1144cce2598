"""A scenario file: what happens to an aircraft, and which frames are expected, one statement per line.

    # A processor dies; another one takes its work.        the comment at the top says why the scenario exists
    spec elevator_and_chute                                a shipped spec, or a file: its path from this file's folder
    seed 7                                                 for the simulator; 0 by default
    loss 0.01                                              one frame in a hundred is destroyed (simulator)
    standby                                                there are two managers, 126 and 127
    keyed                                                  managers and PEs have a key
    unforeseen                                             nothing is pre-planned: the greedy plan flies immediately,
                                                           and the best one follows in the background (simulator)
    without pe:tail_pe                                     this PE is absent at the start
    contingencies 1                                        the contingencies on board answer up to 1 fault at once
    at 2.0s kill pe:control_pe
    expect function:elevator served within 200ms
    end 8s

Several statements may stand on one line, separated by ';'.

Times are seconds from the moment at which the first configuration runs. What can be done:

    kill|restore pe:NAME               the PE is killed, or is started again
    kill|restore manager               kill: the active manager; restore: manager 126
    kill|restore primary|standby       with two managers: 126 is the primary, 127 the standby
    phase NAME       fail|clear KIND:NAME       priority FUNCTION N|default     (orders of the operator)
    script FILE                        (an order, too) run the script in this *.pcs.script file, and keep the
                                       configuration that the script makes; FILE is a path from this file's folder
    release                            (an order, too) end the script that the manager runs
    reload FILE                        (an order, too) change to the spec in this file, likewise (simulator)
    stick device:NAME                  the device still answers, but with its last reading (simulator)
    wait                               nothing is done; the expectations below count from this time
    KIND ELEMENT [for TIME] [in STATE] [level N]        a fault of the simulator (`heronry_tools.sim.faults.fault`)

The time of an expectation counts from the last `at` above the expectation. The expectation is evaluated up to the time
of the next `at`, or to the end of the script:

    function:F served [by MODULE] within TIME|throughout        function:F silent within TIME
    variable:V heard within TIME|throughout                     (a datum, on the managers' bus)
    variable:V silent within TIME
    pe:P active|partial|broken|unconfigured|silent within TIME|throughout
    manager heard|silent within TIME|throughout
    epoch new within TIME               epoch unchanged
    KIND:NAME reported within TIME      nothing reported        (EMCY)

A line that cannot be read raises a UserError with the place and the remedy.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from heronry_dg.model import Spec
from heronry_dg.situation import (
    UnknownElementError,
    checked_element,
    checked_function,
    checked_phase,
    situation,
)
from heronry_manager.core.vocabulary import ClearElement, EnterPhase, FailElement, ReleaseTarget, SetPriority
from heronry_manager.shell.control_protocol import FlyScript
from heronry_tools.console.errors import UserError
from heronry_tools.console.flight_limits import LONGEST_S, read_share
from heronry_tools.console.spec_files import load_spec_file, named_function, spec_path
from heronry_tools.sim.faults.fault import KINDS, MANAGERS, Fault, is_one_of_two, read_fault
from heronry_tools.sim.flight.flyable import reload_file
from heronry_wire.spelling import meant


def _priority(text: str) -> SetPriority:
    function, _, priority = text.partition("=")
    return SetPriority(function, int(priority) if priority else None)


ORDERS: Mapping[
    str, Callable[[str], EnterPhase | SetPriority | FailElement | ClearElement | FlyScript | ReleaseTarget]
] = {
    "phase": EnterPhase,
    "priority": _priority,
    "fail": FailElement,
    "clear": ClearElement,
    "script": FlyScript,
    "release": lambda _: ReleaseTarget(),
}
"""Orders of the operator, by the word for each in a script."""

_NS = {"ms": 1_000_000, "s": 1_000_000_000}
_TIME = re.compile(r"(?P<number>\d{1,6}(\.\d{1,3})?)(?P<unit>ms|s)", re.ASCII)
_EXPECTATION = re.compile(
    r"(?P<subject>\S+) (?P<state>[a-z]+)( by (?P<by>\S+))? (within (?P<time>\S+)|(?P<throughout>throughout))"
)
_WITHOUT_TIME = ("epoch unchanged", "nothing reported")
_ONCE = ("reported", "new")  # states that happen once and do not last
_PE_STATES = ("active", "partial", "broken", "unconfigured", "silent")
EXAMPLE = "expect function:NAME served within 200ms"
_EXAMPLES = {
    "function": EXAMPLE,
    "variable": "expect variable:NAME heard within 200ms",
    "pe": "expect pe:NAME active within 1s",
    "manager": "expect manager heard within 1s",
    "epoch": "expect epoch new within 200ms",
    "nothing": "expect nothing reported",
}


@dataclass(frozen=True, slots=True)
class Deed:
    """An action of a scenario: if `what` is "fault", `fault` is injected; if not, `what` is done to `target`."""

    line: int  # in the scenario file
    at_ns: int  # since the script began
    what: str  # kill, restore, phase, priority, fail, clear, script, release, reload, wait, stick, fault
    target: str  # for the order `script`: the text of the script to apply; for `reload`: the file
    text: str  # the action as written in the scenario file
    fault: Fault | None = None


@dataclass(frozen=True, slots=True)
class Expectation:
    """`subject` must reach `state` in time, and then stay in `state` until `until_ns`.

    by: if `subject` is a function, the module that must serve it; None for any
    from_ns: when the time of the expectation begins, in ns since the script began
    within_ns: the longest time from `from_ns` until the state is reached, in ns
    until_ns: when the time of the expectation ends, in ns since the script began
    """

    line: int  # in the scenario file
    subject: str
    state: str
    by: str | None  # the module that must serve the function
    from_ns: int
    within_ns: int
    until_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class Script:
    """The content of one scenario file."""

    file: Path
    why: str  # the comment at the top of the file
    spec: Spec
    spec_file: Path
    seed: int
    without: frozenset[str]  # PEs that are absent at the start, as pe:NAME
    contingencies: int | None  # most faults at once that contingencies on board cover; None: no contingencies
    has_standby: bool
    has_key: bool
    is_unforeseen: bool  # nothing is pre-planned
    deeds: tuple[Deed, ...]
    expectations: tuple[Expectation, ...]
    end_ns: int  # since the script began
    loss: float = 0.0  # share of the frames that are destroyed, 0 to 0.5

    @property
    def reload(self) -> Path | None:
        """Return the file of the spec to which the aircraft changes; None: it does not."""
        return next((Path(deed.target) for deed in self.deeds if deed.what == "reload"), None)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Return the faults that the simulator injects, in the order of the script."""
        return tuple(deed.fault for deed in self.deeds if deed.fault is not None)

    def reported_modules(self) -> frozenset[str]:
        """Return the modules whose failure the script expects to be reported, so that the report is no violation."""
        expected = (one.subject for one in self.expectations if one.state == "reported")
        return frozenset(name.removeprefix("module:").partition("@")[0] for name in expected if "module:" in name)


def read_script(file: Path) -> Script:
    """Read a scenario file; raises UserError, with the place and the remedy, for a line that cannot be read."""
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise UserError(f"{file}: the file is not text in UTF-8; save it as UTF-8, or name a scenario file") from None
    return _Reader(file).read(text)


@dataclass(slots=True)
class _Reader:
    file: Path
    number: int = 0
    why: list[str] = field(default_factory=list)
    spec: Spec | None = None
    spec_file: Path = Path()
    seed: int = 0
    loss: float = 0.0
    without: set[str] = field(default_factory=set)
    contingencies: int | None = None
    has_standby: bool = False
    has_key: bool = False
    is_unforeseen: bool = False
    deeds: list[Deed] = field(default_factory=list)
    expected: list[Expectation] = field(default_factory=list)  # `until_ns` is not known yet
    end_ns: int | None = None

    def read(self, text: str) -> Script:
        for self.number, line in enumerate(text.splitlines(), start=1):
            if line.startswith("#"):
                self._comment(line)
                continue
            for part in line.partition("#")[0].split(";"):
                words = part.split()
                if words:
                    self._line(words)
        return self._finished()

    def _finished(self) -> Script:
        if not any(self.why):
            self._refuse("the file does not say why it exists; begin it with a comment that says this")
        if self.spec is None:
            self._refuse("the file names no spec; write for example 'spec big_blue'")
        if self.end_ns is None:
            self._refuse("the file does not say when the flight ends; write for example 'end 8s' as the last line")
        return Script(
            self.file,
            " ".join(self.why),
            self.spec,
            self.spec_file,
            self.seed,
            frozenset(self.without),
            self.contingencies,
            self.has_standby,
            self.has_key,
            self.is_unforeseen,
            tuple(self.deeds),
            tuple(self._bounded(one, self.end_ns) for one in self.expected),
            self.end_ns,
            self.loss,
        )

    def _comment(self, line: str) -> None:
        if self.spec is None:
            self.why.append(line.removeprefix("#").strip())

    def _line(self, words: list[str]) -> None:
        if self.end_ns is not None:
            self._refuse("no line may follow 'end'; move this line up, or 'end' down")
        match words:
            case ["spec", *name] if self.spec is None and name:
                self.spec, self.spec_file = self._loaded(" ".join(name))
            case ["spec", *_] if self.spec is not None:
                self._refuse("a scenario has one spec; leave this second 'spec' line out")
            case _ if self.spec is None:
                self._refuse("the first line must name the spec; write for example 'spec big_blue' above this line")
            case ["seed", number] if number.isdecimal():
                self.seed = int(number)
            case ["loss", text] if (share := read_share(text)) is not None:
                self.loss = share
            case ["at", time, *deed] if deed:
                self._deed(self._ns(time), deed)
            case ["expect", *expectation] if expectation:
                self._expectation(expectation)
            case ["end", time]:
                self.end_ns = self._not_before(self._ns(time))
            case _ if self.deeds or not self._prepared(words):
                self._refuse(
                    f"'{' '.join(words)}' cannot be read; a line is 'spec NAME', 'seed NUMBER', 'loss SHARE' "
                    "(0 to 0.5), 'standby', 'keyed', 'unforeseen', 'contingencies 0|1|2', 'without pe:NAME' "
                    "(before anything is done), 'at TIME ...', 'expect ...' or 'end TIME'"
                )

    def _prepared(self, words: list[str]) -> bool:
        """Read a line if it describes the aircraft before the first deed, for example `standby`.

        Returns whether the line is of this kind; if not, the line is not read.
        """
        match words:
            case ["standby"]:
                self.has_standby = True
            case ["keyed"]:
                self.has_key = True
            case ["unforeseen"]:
                self.is_unforeseen = True
            case ["without", pe]:
                self.without.add(self._pe(pe))
            case ["contingencies", faults] if faults in ("0", "1", "2"):
                self.contingencies = int(faults)
            case _:
                return False
        return True

    def _loaded(self, name: str) -> tuple[Spec, Path]:
        path = str(self.file.parent / name) if Path(name).suffix else name
        try:
            return load_spec_file(path), spec_path(path)
        except UserError as error:
            self._refuse(str(error))

    # What is done

    def _deed(self, at_ns: int, words: list[str]) -> None:
        self._not_before(at_ns)
        text = " ".join(words)
        if not self.has_standby and words[0] not in ("phase", "priority") and any(map(is_one_of_two, words[1:2])):
            remedy = "write 'manager', or a line 'standby' before this one"
            self._refuse(f"'{text}': the flight has only one manager; {remedy}")
        match words:
            case ["kill" | "restore" as what, target]:
                deed = Deed(self.number, at_ns, what, target if target in MANAGERS else self._pe(target), text)
                self._in_turn(deed)
            case ["phase", phase]:
                deed = Deed(self.number, at_ns, "phase", self._checked_phase(phase), text)
            case ["priority", function, priority]:
                deed = Deed(self.number, at_ns, "priority", self._checked_priority(function, priority), text)
            case ["fail" | "clear" as what, element]:
                deed = Deed(self.number, at_ns, what, self._element(element), text)
            case ["script", name]:
                deed = Deed(self.number, at_ns, "script", self._script_text(name), text)
            case ["reload", name]:
                deed = Deed(self.number, at_ns, "reload", self._reload(name), text)
            case ["wait"]:
                deed = Deed(self.number, at_ns, "wait", "", text)
            case ["release"]:
                deed = Deed(self.number, at_ns, "release", "", text)
            case ["stick", device] if device.startswith("device:"):
                deed = Deed(self.number, at_ns, "stick", self._element(device), text)
            case [kind, target, *_] if kind in KINDS:
                deed = Deed(self.number, at_ns, "fault", target, text, self._fault(at_ns, words))
            case _:
                known = ["kill", "restore", *ORDERS, "reload", "wait", "stick", *KINDS]
                remedy = meant(words[0], known, f"what can be done is {', '.join(known)}")
                self._refuse(f"'{text}' cannot be done; {remedy}")
        self.deeds.append(deed)

    def _script_text(self, name: str) -> str:
        file = self.file.parent / name
        try:
            return file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = "it is not text in UTF-8" if isinstance(error, UnicodeDecodeError) else error.strerror
            self._refuse(f"{file}: {reason}; name a *.pcs.script file")

    def _in_turn(self, deed: Deed) -> None:
        """Raise UserError if the deed kills a target that does not run, or restores one that runs."""
        before = [d.what for d in self.deeds if d.target == deed.target and d.what in ("kill", "restore")]
        runs = before[-1] == "restore" if before else deed.target not in self.without
        if runs != (deed.what == "kill"):
            self._refuse(f"{deed.target} {'runs' if runs else 'does not run'} at that time; kill and restore in turn")

    def _reload(self, name: str) -> str:
        """Return the path of the file of another spec, of which a scenario has one."""
        assert self.spec is not None
        path = str(self.file.parent / name)
        if any(deed.what == "reload" and deed.target != path for deed in self.deeds):
            self._refuse("a scenario changes to one other spec; name the same file again, or leave this line out")
        try:
            reload_file(self.spec, path)
        except UserError as error:
            self._refuse(str(error))
        return path

    def _fault(self, at_ns: int, words: list[str]) -> Fault:
        plain = list(words)
        for position, word in enumerate(words[:-1]):
            if word == "for":
                plain[position + 1] = _plain_seconds(self._ns(words[position + 1]))
        assert self.spec is not None
        try:
            return read_fault(self.spec, f"{_plain_seconds(at_ns)} {' '.join(plain)}")
        except UserError as error:
            self._refuse(str(error))

    # What is expected

    def _expectation(self, words: list[str]) -> None:
        text = " ".join(words)
        match = _EXPECTATION.fullmatch(f"{text} throughout" if text in _WITHOUT_TIME else text)
        if match is None or (match["throughout"] and match["state"] in _ONCE and text not in _WITHOUT_TIME):
            example = _EXAMPLES.get(words[0].partition(":")[0], _EXAMPLES["function"])
            self._refuse(f"'{text}' cannot be read; write for example '{example}'")
        subject, state, by = match["subject"], match["state"], match["by"]
        within_ns = self._ns(match["time"]) if match["time"] else 0
        self._check_subject(subject, state, by)
        from_ns = self.deeds[-1].at_ns if self.deeds else 0
        self.expected.append(Expectation(self.number, subject, state, by, from_ns, within_ns, 0, text))

    def _check_subject(self, subject: str, state: str, by: str | None) -> None:
        kind, _, name = subject.partition(":")
        match kind, state:
            case ("function", "served" | "silent") if by is None or state == "served":
                self._function(name, by)
            case _ if by is not None:
                self._refuse(f"only a function is served by a module; write for example '{_EXAMPLES['function']}'")
            case ("variable", "heard" | "silent"):
                self._variable(name)
            case ("pe", _) if state in _PE_STATES:
                self._pe(subject)
            case ("manager", "heard" | "silent") | ("epoch", "new" | "unchanged") | ("nothing", "reported"):
                pass
            case (_, "reported"):
                self._element(subject)
            case _:
                example = _EXAMPLES.get(kind, _EXAMPLES["function"])
                self._refuse(f"'{subject}' cannot be expected to be '{state}'; write for example '{example}'")

    def _function(self, name: str, by: str | None) -> None:
        assert self.spec is not None
        try:
            function = named_function(self.spec, name)
        except UserError as error:
            self._refuse(str(error))
        if by is not None and by not in function.outputs:
            self._refuse(f"{by} is no output of {name}; it has {', '.join(function.outputs)}")

    def _variable(self, name: str) -> None:
        assert self.spec is not None
        if name not in self.spec.variables:
            self._refuse(f"no variable is named '{name}'; {meant(name, self.spec.variables, there_is='the spec has')}")

    def _bounded(self, one: Expectation, end_ns: int) -> Expectation:
        """Return a copy of an expectation with its end, `until_ns`: the next deed, or `end_ns` if no deed follows.

        end_ns: the end of the script.
        Raises UserError if the time to reach the state (`within_ns`) lasts up to this end, or beyond it.
        """
        until_ns = next((deed.at_ns for deed in self.deeds if deed.at_ns > one.from_ns), end_ns)
        if one.from_ns + one.within_ns >= until_ns:
            self.number = one.line
            self._refuse(
                f"the next 'at' or 'end', at {_plain_seconds(until_ns)}s, comes before the time of this expectation is "
                "over; move it to a later time, or shorten the time of the expectation"
            )
        return Expectation(one.line, one.subject, one.state, one.by, one.from_ns, one.within_ns, until_ns, one.text)

    # Words

    def _ns(self, text: str) -> int:
        match = _TIME.fullmatch(text)
        if match is None:
            self._refuse(f"'{text}' is not a time; write it as 2.5s or 80ms")
        whole, _, fraction = match["number"].partition(".")
        ns = (int(whole) * 1000 + int(fraction.ljust(3, "0") or 0)) * (_NS[match["unit"]] // 1000)
        if ns > LONGEST_S * _NS["s"]:
            self._refuse(f"'{text}' is longer than a flight may be; write {LONGEST_S}s or less")
        return ns

    def _not_before(self, at_ns: int) -> int:
        last_ns = self.deeds[-1].at_ns if self.deeds else 0
        if at_ns < last_ns:
            self._refuse(f"{_plain_seconds(at_ns)}s is before {_plain_seconds(last_ns)}s; write lines in order of time")
        return at_ns

    def _pe(self, element: str) -> str:
        if not element.startswith("pe:"):
            self._refuse(f"'{element}' is not a PE; write pe:NAME")
        return self._element(element)

    def _element(self, element: str) -> str:
        assert self.spec is not None
        try:
            return checked_element(self.spec, element)
        except UnknownElementError as error:
            self._refuse(str(error))

    def _checked_priority(self, function: str, priority: str) -> str:
        """Return the order FUNCTION=N, or FUNCTION= if `priority` is "default".

        Raises UserError if the function or the priority is wrong.
        """
        assert self.spec is not None
        try:
            checked_function(self.spec, function)
            if priority == "default":
                return f"{function}="
            situation(self.spec, priorities=[f"{function}={priority}"])
        except UnknownElementError as error:
            self._refuse(str(error))
        return f"{function}={priority}"

    def _checked_phase(self, phase: str) -> str:
        assert self.spec is not None
        try:
            return checked_phase(self.spec, phase)
        except UnknownElementError as error:
            self._refuse(str(error))

    def _refuse(self, sentence: str) -> NoReturn:
        raise UserError(f"{self.file}:{max(self.number, 1)}: {sentence}")  # also where there is no line at all


def _plain_seconds(ns: int) -> str:
    return f"{ns / 1e9:.3f}".rstrip("0").rstrip(".")
