"""What a page asks for: the variables of its plots. And what it is told of each at first, and of who uses it."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

from heronry_dg.model import Spec
from heronry_tools.watch.data_samples import DataSource, data_sources, has_numbers
from heronry_tools.watch.snapshot import Snapshot
from heronry_tools.web.plots.tracks import Track
from heronry_wire.errors import HeronryError
from heronry_wire.spelling import meant

MOST_VARIABLES: Final = 8  # in one request

Uses = dict[str, list[str]]  # producer -> modules that are wired to it


class PlotError(HeronryError):
    """A request for plots that cannot be answered; the message says what to change."""


def checked_variables(spec: Spec, names: Sequence[str]) -> list[str]:
    """Return the names of variables, each once; raises PlotError if one of them cannot be plotted."""
    found = list(dict.fromkeys(names))
    if not found:
        raise PlotError("name the variable to plot, as in ?variable=NAME")
    if len(found) > MOST_VARIABLES:
        raise PlotError(f"{len(found)} variables are more than the {MOST_VARIABLES} that one request may name")
    for name in found:
        variable = spec.variables.get(name)
        if variable is None:
            raise PlotError(f"the spec has no variable '{name}'; {meant(name, spec.variables)}")
        if not has_numbers(variable):
            raise PlotError(f"the data of {name} are of type {variable.type}: no numbers, so there is nothing to plot")
    return found


class Sources:
    """The sources of one spec, by variable and by identifier."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self.by_identifier = data_sources(spec)

    def of(self, variable: str) -> list[DataSource]:
        """Return the sources of a variable, in the order of the spec."""
        return [source for source in self.by_identifier.values() if source.variable == variable]

    def told(self, variable: str) -> dict[str, Any]:
        """Return what a page is told of a variable, except its samples."""
        of, sources = self.spec.variables[variable], self.of(variable)
        return {
            "variable": variable,
            "unit": of.unit,
            "is_stepped": of.type != "FLOAT",
            "series": [
                {"producer": source.producer, "part": part, "parts": source.parts, "fresh_ns": source.fresh_ns}
                for source in sources
                for part in range(source.parts)
            ],
        }


def uses(snapshot: Snapshot) -> dict[str, Uses]:
    """Return for each variable that a module reads now the producers from which it is read, each with these modules."""
    found: dict[str, Uses] = {}
    for reader, module in snapshot.modules.items():
        for wire in module.wires.values():
            readers = found.setdefault(wire.variable, {}).setdefault(wire.producer, [])
            if reader not in readers:
                readers.append(reader)
    return found


def refusals(tracks: Iterable[Track]) -> dict[str, list[Any]]:
    """Return for each producer of which frames were refused their number, and the reason for the last one."""
    return {track.source.producer: [track.refused, track.why_refused] for track in tracks if track.refused}
