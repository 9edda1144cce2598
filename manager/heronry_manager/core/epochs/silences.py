"""Inputs and outputs of running modules that are silent, as the PEs of these modules report (EMCY STALE).

    told    the PE has reported the silence within the last 3.5 s (CHANNEL_FORGOTTEN_NS), and the current epoch still
            has the input or output: the same module on the same PE, and the same wire
    over    the PE has reported the end; or it has not repeated its report for so long; or the current epoch no longer
            has the input or output

Events report when a silence begins and when it is over; `heronry status` lists the silences.

A silence changes no plan, with one exception. If an output of a module with `silent: fails` is silent, the module has
failed on this PE: a fault is latched on its place, as if its PE had stopped it. The operator clears it as any other
fault. An input never makes a module fail: its producer may send, and the way be cut.

*Not believed* is a report that the manager can explain better: of a PE that is not available, or does not run the
current epoch; of an input whose producer has failed, or is on a PE that is not available or is suspect. The PE repeats
what is still true within a second.

*Lost, late, doubled and forged reports.* A PE repeats its report every second, so a lost one comes again; if the report
of an end is lost, the silence ends 3.5 s after its last report. A doubled report has no effect. A late one may begin a
silence that is over; it ends 3.5 s later. Without a key a forged report makes a false event, and may make a module with
`silent: fails` fail; with a key a report counts only when a page 0 has proven it. A manager that restarts or takes over
knows all silences within a second.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, Literal

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.epochs.deployment import Deployment
from heronry_manager.core.membership import Health, Standing
from heronry_manager.core.turn import Turn
from heronry_wire.management import ElementKind, Emergency
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS
from heronry_wire.silence import Silence

_Why = Literal["data come again", "no longer reported", "no longer part of what runs"]
_Key = tuple[str, str, Silence]  # module, PE, and which input or output (with `is_over` false)


@dataclass(frozen=True, slots=True)
class _What:
    """What is silent: a variable; of an input also the module that should give it."""

    variable: str
    producer: str | None

    @property
    def kind(self) -> Literal["input", "output"]:
        return "output" if self.producer is None else "input"


@dataclass(slots=True)
class _Told:
    what: _What
    since_ns: int
    at_ns: int


class Silences:
    """Keeps the silent inputs and outputs, by module and PE."""

    def __init__(
        self,
        spec: Spec,
        turn: Turn,
        health: Health,
        deployment: Deployment,
        *,
        failed: Callable[[], Collection[str]],
    ) -> None:
        """Begin without silences; `failed` gives the elements on which a fault is latched."""
        self._failed = failed
        self._spec, self._turn, self._health, self._deployment = spec, turn, health, deployment
        self._modules, self._variables = list(spec.modules), list(spec.variables)
        self._told: dict[_Key, _Told] = {}
        self._looked_at: object = None  # the epoch for which the silences were compared with the configuration

    def forget(self) -> None:
        """Forget all silences, without an event."""
        self._told.clear()
        self._looked_at = None

    def reported(self, pe: str, emergency: Emergency) -> str | None:
        """Take the report of a PE.

        Gives the element that has failed: the module, if it is to fail by its silence; None: nothing has failed.
        """
        if emergency.kind is not ElementKind.MODULE or emergency.index >= len(self._modules):
            return None
        module, said = self._modules[emergency.index], Silence.of(emergency.detail)
        key = module, pe, Silence(said.number, said.is_output)
        if said.is_over:
            self._end(key, "data come again")
            return None
        what = self._what(key)
        if what is None or not self._is_believed(pe, what):
            return None
        told = self._told.get(key)
        if told is not None:
            told.at_ns = self._turn.now_ns
        else:
            self._told[key] = _Told(what, self._turn.now_ns, self._turn.now_ns)
            self._begun(module, pe, what)
        fails = said.is_output and self._spec.modules[module].silent == "fails"
        return f"module:{module}" if fails else None

    def beat(self) -> None:
        """End each silence that its PE has not repeated, or that the current epoch does not have."""
        current = self._deployment.current
        has_changed, self._looked_at = current is not self._looked_at, current
        for key, told in list(self._told.items()):
            if has_changed and self._what(key) != told.what:
                self._end(key, "no longer part of what runs")
            elif self._turn.now_ns - told.at_ns > CHANNEL_FORGOTTEN_NS:
                self._end(key, "no longer reported")

    def all(self) -> list[dict[str, Any]]:
        """Return what the status shows of each silence, the oldest first."""
        return [
            {
                "module": module,
                "by": pe,
                "what": told.what.kind,
                "variable": told.what.variable,
                "producer": told.what.producer,
                "for_ns": self._turn.now_ns - told.since_ns,
            }
            for (module, pe, _), told in self._told.items()
        ]

    def _begun(self, module: str, pe: str, what: _What) -> None:
        if what.producer is None:
            self._turn.emit(events.OutputSilent, module=module, by=pe, variable=what.variable)
        else:
            told = {"variable": what.variable, "producer": what.producer}
            self._turn.emit(events.InputSilent, module=module, by=pe, **told)

    def _end(self, key: _Key, why: _Why) -> None:
        told = self._told.pop(key, None)
        if told is not None:
            module, pe, _ = key
            what, for_ns = told.what, self._turn.now_ns - told.since_ns
            self._turn.emit(
                events.SilenceOver,
                module=module,
                by=pe,
                variable=what.variable,
                what=what.kind,
                why=why,
                for_ns=for_ns,
            )

    def _is_believed(self, pe: str, what: _What) -> bool:
        """Tell whether a PE runs the current epoch, and whether the producer of an input can be expected to give it."""
        current, health = self._deployment.current, self._health
        is_current = current is not None and self._deployment.observed.of[pe].epoch == current.epoch
        if not health.is_available(pe) or not is_current or what.producer is None:
            return is_current and health.is_available(pe)
        origin = self._configuration().modules[what.producer].pe
        if any(f"module:{what.producer}{place}" in self._failed() for place in ("", f"@{origin}")):
            return False
        return health.is_available(origin) and health.standing(origin) is not Standing.SUSPECT

    def _what(self, key: _Key) -> _What | None:
        """Return the variable that a report means; None: the current epoch has no such input or output."""
        module, pe, silence = key
        running = self._configuration().modules.get(module)
        if running is None or running.pe != pe:
            return None
        return (
            self._output(module, silence.number) if silence.is_output else self._input(module, running, silence.number)
        )

    def _output(self, module: str, number: int) -> _What | None:
        variable = self._variables[number] if number < len(self._variables) else ""
        gives = self._configuration().mode(self._spec, module).gives
        return _What(variable, None) if variable in gives else None

    def _input(self, module: str, running: Running, number: int) -> _What | None:
        leaves = list(self._configuration().mode(self._spec, module).leaves())
        wire = running.inputs.get(leaves[number][0]) if number < len(leaves) else None
        return None if wire is None else _What(wire.variable, wire.producer)

    def _configuration(self) -> Configuration:
        current = self._deployment.current
        return Configuration() if current is None else current.configuration
