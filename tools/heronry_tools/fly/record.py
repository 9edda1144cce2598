"""The record of one flight, from which its pictures and statistics are made and its landing is assessed.

A record has columns of numbers over time, stretches of time in which something had one state, and marks at single
times. The JSON form of a record is complete, so the pictures can be made from it again without another flight.

Columns. A name ends with the unit. There is always the column `time_s`; every other column is as long, and has None
where its value was not known. A column with the real state of the aircraft has the name of its field in `plant.Truth`.
The prefix `estimate_` marks what the avionics estimate for such a field. The prefix `sigma_` marks the standard
deviation that the filter gives for the field. The column `load_BUS` has the load of a bus, as a share of its bit rate.

    x_m, estimate_x_m, sigma_x_m       time_s       elevator_deg, throttle       load_can0, load_radio

Stretches and marks. A stretch has a kind, a subject and a label. Kind `mode` has the stages of the landing as labels;
kind `phase` has the phases of the spec. Kind `place` has a module as subject, and the PE and mode of the module as
label. A mark has a kind (fault, reconfigured, refused, touchdown, note), and a sentence for the reader.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

from heronry_dg.plan_document import PlanDocument
from heronry_tools.fly.acceptance import Cause, Site, Touchdown, causes
from heronry_tools.fly.plant import Truth

FORMAT = 1

StretchKind = Literal["mode", "phase", "place"]
MarkKind = Literal["fault", "reconfigured", "refused", "touchdown", "note"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """From `start_s` to `end_s` the subject was in the state `label`."""

    kind: StretchKind
    subject: str
    label: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Mark:
    """An event at one time of the flight."""

    time_s: float
    kind: MarkKind
    text: str


@dataclass(frozen=True, slots=True)
class FlightRecord:
    """The record of one flight.

    spec: name of the spec
    title: what was special in this flight
    site: where the aircraft was to land
    """

    spec: str
    title: str
    seed: int
    columns: Mapping[str, tuple[float | None, ...]]
    stretches: tuple[Stretch, ...]
    marks: tuple[Mark, ...]
    touchdown: Touchdown | None
    site: Site = "runway"

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Return the criteria that the landing does not meet; empty for an acceptable landing."""
        return causes(self.touchdown, self.site)

    @property
    def times_s(self) -> tuple[float, ...]:
        """Return the time of each row."""
        return tuple(time_s or 0.0 for time_s in self.columns["time_s"])

    def known(self, name: str) -> bool:
        """Tell whether a column has at least one value other than None."""
        return any(value is not None for value in self.columns.get(name, ()))

    def as_json(self) -> str:
        """Return the record as JSON text."""
        return json.dumps({"format": FORMAT, **asdict(self)}, separators=(",", ":"))

    @staticmethod
    def from_json(text: str) -> "FlightRecord":
        """Read the JSON text of a record; raises a ValueError that tells what is wrong with the text."""
        try:
            return _read(json.loads(text))
        except (TypeError, KeyError, AttributeError) as problem:
            raise ValueError(f"the text is not the record of a flight: {problem}") from problem


def _read(form: dict[str, Any]) -> FlightRecord:
    if form.get("format") != FORMAT:
        raise ValueError(f"the record has format {form.get('format')!r}; this version of heronry reads {FORMAT}")
    landed = form["touchdown"]
    return FlightRecord(
        form["spec"],
        form["title"],
        form["seed"],
        {name: tuple(values) for name, values in form["columns"].items()},
        tuple(Stretch(**stretch) for stretch in form["stretches"]),
        tuple(Mark(**mark) for mark in form["marks"]),
        None if landed is None else Touchdown(**{**landed, "structure": tuple(landed["structure"])}),
        form["site"],
    )


class Recorder:
    """Makes the record of a flight during the flight; the times of its calls must not decrease."""

    def __init__(self, spec: str, title: str, seed: int, site: Site = "runway") -> None:
        self._site: Site = site
        self._spec, self._title, self._seed = spec, title, seed
        self._rows: list[Mapping[str, float | None]] = []
        self._states: dict[tuple[StretchKind, str], tuple[str, float]] = {}
        self._stretches: list[Stretch] = []
        self._marks: list[Mark] = []
        self._touchdown: Touchdown | None = None
        self._structure: set[str] = set()

    @property
    def touchdown(self) -> Touchdown | None:
        """Return the state at the first contact with the ground; None before that."""
        if self._touchdown is None:
            return None
        return _with_structure(self._touchdown, self._structure)

    def sample(self, truth: Truth, known: Mapping[str, float | None]) -> None:
        """Add a row.

        truth: real state of the aircraft, with the time of the row
        known: further values, by name of the column
        """
        row: dict[str, float | None] = {
            field.name: getattr(truth, field.name) for field in fields(Truth) if field.name != "touching"
        }
        self._rows.append({**row, **known})
        self.watch(truth)

    def watch(self, truth: Truth) -> None:
        """Note contacts with the ground; call this after each step near the ground, even if the step adds no row.

        `sample`, which adds a row to the record, calls this method itself.
        """
        if truth.touching and self._touchdown is None:
            self._touchdown = _touchdown(truth)
            self.mark(truth.time_s, "touchdown", "the aircraft touches the ground")
        self._structure.update(name for name in truth.touching if not is_wheel(name))

    def state(self, time_s: float, kind: StretchKind, subject: str, label: str | None) -> None:
        """Record that the subject has the state `label` from `time_s` on; a label of None: it has no state.

        If `label` differs from the label before, the previous stretch of the subject ends; else that stretch goes on.
        """
        before = self._states.get((kind, subject))
        if before is not None:
            if before[0] == label:
                return
            self._close(kind, subject, time_s)
        if label is not None:
            self._states[kind, subject] = (label, time_s)

    def mark(self, time_s: float, kind: MarkKind, text: str) -> None:
        """Add a mark; `text` is a sentence for the reader."""
        self._marks.append(Mark(time_s, kind, text))

    def finished(self) -> FlightRecord:
        """Return the record up to the last row."""
        end_s = self._rows[-1]["time_s"] or 0.0 if self._rows else 0.0
        for kind, subject in list(self._states):
            self._close(kind, subject, end_s)
        names = dict.fromkeys(name for row in self._rows for name in row)
        columns = {name: tuple(row.get(name) for row in self._rows) for name in names or ("time_s",)}
        stretches = tuple(sorted(self._stretches, key=lambda s: (s.start_s, s.kind, s.subject)))
        marks = tuple(sorted(self._marks, key=lambda mark: mark.time_s))
        return FlightRecord(self._spec, self._title, self._seed, columns, stretches, marks, self.touchdown, self._site)

    def _close(self, kind: StretchKind, subject: str, end_s: float) -> None:
        label, start_s = self._states.pop((kind, subject))
        self._stretches.append(Stretch(kind, subject, label, start_s, end_s))


def place_labels(plan: PlanDocument) -> dict[str, str]:
    """Return, by name of each module in a plan, its PE and mode as the label `PE (MODE)`."""
    return {name: f"{one.pe} ({one.mode})" for name, one in plan.modules.items()}


def is_wheel(contact: str) -> bool:
    """Tell from its name whether a contact is a wheel or a skid; every other contact is a part of the structure."""
    return contact.endswith(("wheel", "skid"))


def _touchdown(truth: Truth) -> Touchdown:
    return Touchdown(
        truth.time_s, truth.x_m, truth.y_m, -truth.up_m_per_s, truth.roll_deg, truth.pitch_deg, truth.airspeed_m_per_s
    )


def _with_structure(landed: Touchdown, structure: set[str]) -> Touchdown:
    return Touchdown(**{**asdict(landed), "structure": tuple(sorted(structure))})
