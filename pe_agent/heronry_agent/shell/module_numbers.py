"""The numbers by which a host knows its modules, which stay when another table takes the place of the one that flies.

A core names modules by their indices in the table that flies. The processes of modules and the devices outlive a table,
so the host knows each module by a number of its own: that of the same module in the same partition, or a new one. With
the first table number and index are the same. Actions are translated on their way in, events on their way out.
"""

from dataclasses import replace

from heronry_agent.core.vocabulary import (
    Action,
    AtRest,
    Drive,
    DriveFailed,
    Driven,
    MeasureStep,
    ModuleEvent,
    NotReady,
    PartitionEnded,
    SaveState,
    StartFailed,
    StartModule,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_wire.pe_table import ModuleEntry, PeTable
from heronry_wire.sansio import require

_NONE = -1  # index of a module that the table which flies does not have


class ModuleNumbers:
    """Translates between the indices of the table that flies and the numbers of a host."""

    def __init__(self, table: PeTable) -> None:
        self._table = self._beside_table = table
        self._number_of = {module.index: module.index for module in table.modules}
        self._index_of, self._beside = dict(self._number_of), dict(self._number_of)
        self._next = 1 + max(self._number_of, default=0)
        self._is_first = True  # numbers and indices are the same

    def of(self, table: PeTable) -> tuple[dict[int, int], list[ModuleEntry]]:
        """Return the numbers of a table's modules, by index, and those modules, by number, that are new to the host."""
        here = {(module.name, module.partition): self._number_of[module.index] for module in self._table.modules}
        numbers, new = {}, []
        for module in table.modules:
            number = here.get((module.name, module.partition))
            if number is None:
                number, self._next = self._next, self._next + 1
                new.append(replace(module, index=number))
            numbers[module.index] = number
        return numbers, new

    def has(self, table: PeTable) -> bool:
        """Tell whether this table flies, or is beside: then the host is prepared for it."""
        return table.identity in (self._table.identity, self._beside_table.identity)

    @property
    def in_use(self) -> frozenset[int]:
        """Numbers of the modules of the table that flies, and of the one beside it."""
        return frozenset((*self._number_of.values(), *self._beside.values()))

    def forget_beside(self) -> None:
        """Note that no table is beside any more, since the core has begun anew."""
        self._beside_table, self._beside = self._table, self._number_of

    def put_beside(self, table: PeTable, numbers: dict[int, int]) -> None:
        """Note which table is beside, for which the host is prepared; `numbers`: as `of` has given them."""
        self._beside_table, self._beside = table, numbers

    def switch(self, table: PeTable) -> None:
        """Translate by this table from now on: the one beside, which changes places with the one that flies."""
        require(table is self._beside_table, "the table that flies from now on is not the one beside")
        self._table, self._beside_table = self._beside_table, self._table
        self._number_of, self._beside = self._beside, self._number_of
        self._index_of = {number: index for index, number in self._number_of.items()}
        self._is_first = False

    def indices(self, numbers: frozenset[int], *, beside: bool = False) -> frozenset[int]:
        """Return the indices of these modules in the table that flies, or in the one beside it."""
        known = self._beside if beside else self._number_of
        return frozenset(index for index, number in known.items() if number in numbers)

    def index(self, number: int) -> int | None:
        """Return the index of a module in the table that flies; None: that table does not have it."""
        return self._index_of.get(number)

    def inward(self, action: Action) -> Action:
        """Return an action for the host."""
        if self._is_first:
            return action
        match action:
            case StepModule():
                return action._replace(module=self._number_of[action.module])
            case StartModule():
                number = self._number_of[action.module]
                return replace(action, module=number, entry=replace(action.entry, index=number))
            case StopModule() | SaveState() | MeasureStep() | Drive():
                return replace(action, module=self._number_of[action.module])
            case _:
                return action

    def outward(self, event: ModuleEvent) -> ModuleEvent | None:
        """Return an event for the core; None: it is of a module that the table which flies does not have."""
        if self._is_first:
            return event
        match event:
            case PartitionEnded(computing=number) if number is not None:
                return replace(event, computing=self._index_of.get(number, _NONE))
            case Stepped(module=number):
                index = self._index_of.get(number)
                return None if index is None else event._replace(module=index)
            case (
                StepFailed()
                | StartFailed()
                | NotReady()
                | StepMeasured()
                | Driven()
                | DriveFailed()
                | AtRest()
                | StateSaved()
                | StateRestored()
                | StateLacking()
                | StateUnused()
            ):
                index = self._index_of.get(event.module)
                return None if index is None else replace(event, module=index)
            case _:
                return event
