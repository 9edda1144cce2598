"""Resource-aware cut sets: what is left of PEs and buses cannot carry what a function needs.

Only planning finds them, one set of faults after the other, the smaller ones first. Few sets are planned for:

- Only elements that can matter to the function are tried (`Failure.reach`).
- A set that contains a cut set, logical or found before, is skipped: it loses the function, too.
- A set is settled without a search if a configuration that is known already survives it, or if it leaves exactly what
  another set has left.

The sets of one size do not depend on each other. They are numbered and divided into parts; processes take the parts,
and a journal keeps those that are done, so that a killed run goes on where it ended.
"""

import json
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from math import comb
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager.checked_lines import DAMAGED, checked_line, line_content
from heronry_manager.planner.sweep import FaultSet, what_is_left
from heronry_tools.analysis.servable import Planning
from heronry_tools.console.errors import UserError
from heronry_tools.console.processes import held_back

_SETS_IN_A_PART: Final = 512
_PARTS_AHEAD: Final = 16
_PROCESS_PAYS: Final = 4  # parts for each process, or the start of the process takes longer than it saves


class Servable:
    """Tells for a fault set whether any legal configuration can still serve one function."""

    def __init__(self, spec: Spec, function: str) -> None:
        self.spec, self.function = spec, function
        self._planning = Planning(spec)
        self._by_rest: dict[object, bool] = {}

    def after(self, down: FaultSet) -> bool:
        """Tell whether a legal configuration can serve the function while the elements in `down` are down.

        Raises UserError if the search finds no answer to this question.
        """
        if self._planning.survives((self.function,), down):
            return True
        rest = what_is_left(survivors(self._planning.spec, Situation(down)))
        if rest not in self._by_rest:
            answer = self._planning.all_at_once((self.function,), down)
            if not answer.proven:
                lost = ", ".join(sorted(down)) or "nothing"
                raise UserError(
                    f"the search reached its limit before it was known whether function {self.function} can be served "
                    f"with {lost} down; lower --order, or simplify what serves this function in the spec"
                )
            self._by_rest[rest] = answer.configuration is not None
        return self._by_rest[rest]


@dataclass(frozen=True, slots=True)
class Part:
    """The sets of one size that begin at a number, in the order of `combinations`; `cuts` are known to lose already."""

    spec: Spec
    function: str
    elements: tuple[str, ...]
    size: int
    first: int
    count: int
    cuts: tuple[FaultSet, ...]


_warm: list[Servable] = []  # what this process knows about the function of its last part


def losing(part: Part) -> list[FaultSet]:
    """Find the sets of a part that lose the function, and contain no cut set known before."""
    if not _warm or _warm[0].function != part.function or _warm[0].spec != part.spec:
        _warm[:] = [Servable(part.spec, part.function)]
    return [down for down in _open_sets(part) if not _warm[0].after(down)]


def _open_sets(part: Part) -> Iterator[FaultSet]:
    bit = {element: 1 << index for index, element in enumerate(part.elements)}
    cuts = [sum(bit[element] for element in cut) for cut in part.cuts if bit.keys() >= cut]
    for chosen in _from(part.elements, part.size, part.first, part.count):
        mask = sum(bit[element] for element in chosen)
        if not any(cut & mask == cut for cut in cuts):
            yield frozenset(chosen)


def _from(elements: tuple[str, ...], size: int, first: int, count: int) -> Iterator[tuple[str, ...]]:
    """Yield `count` combinations from number `first` on, without those before it."""
    chosen, index, left = list[int](), 0, first
    for place in range(size):
        while (skipped := comb(len(elements) - index - 1, size - place - 1)) <= left:
            left -= skipped
            index += 1
        chosen.append(index)
        index += 1
    for _ in range(count):
        yield tuple(elements[index] for index in chosen)
        place = size - 1
        while place >= 0 and chosen[place] == len(elements) - size + place:
            place -= 1
        if place < 0:
            return
        chosen[place] += 1
        for later in range(place + 1, size):
            chosen[later] = chosen[later - 1] + 1


class Journal:
    """The parts that a run has done, in a file: a line for each; a line that was not written whole is dropped."""

    def __init__(self, file: Path, about: object) -> None:
        """Open a journal, or begin one; `about` says what is searched, as JSON: raises UserError for another search."""
        self.file = file
        self.known: dict[tuple[int, int], list[FaultSet]] = {}
        head = json.loads(json.dumps(about))
        try:
            lines = file.read_bytes().splitlines(keepends=True) if file.exists() else []
            if lines and line_content(lines[0]) != head:
                raise UserError(f"{file} is the journal of another search, or damaged; remove it, or name another file")
            good = [checked_line(head)]
            for line in lines[1:]:
                content = line_content(line)
                if content is DAMAGED or not isinstance(content, list):
                    break
                size, first, sets = content
                self.known[size, first] = [frozenset(one) for one in sets]
                good.append(line)
            file.write_bytes(b"".join(good))
            self._open = file.open("ab")
        except OSError as error:
            raise UserError(f"{file}: {error.strerror}; name a file that can be written") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    @property
    def sets(self) -> int:
        """About how many fault sets are settled: each part that is done counts as a whole one."""
        return len(self.known) * _SETS_IN_A_PART

    def add(self, part: Part, sets: Iterable[FaultSet]) -> None:
        """Keep what a part has found."""
        self._open.write(checked_line([part.size, part.first, [sorted(one) for one in sets]]))
        self._open.flush()

    def remove(self) -> None:
        """Remove the journal, since the search is complete."""
        self.file.unlink(missing_ok=True)


def resource_sets(
    spec: Spec,
    function: str,
    elements: Collection[str],
    order: int,
    logical: Collection[FaultSet],
    *,
    executor: Executor | None = None,
    journal: Journal | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> tuple[FaultSet, ...]:
    """Find the smallest sets of up to `order` elements that lose a function with real resources, smaller ones first.

    elements: those that may fail, and can matter.
    logical: the logical cut sets of up to `order` elements; those that are smallest with real resources, too, are among
        the result.
    executor: processes that plan; None: this process plans.
    advance: called with the number of fault sets that are settled.

    Raises UserError if a search finds no answer, or if a process has ended.
    """
    named = tuple(elements)
    found: list[FaultSet] = []
    for size in range(min(order, len(named)) + 1):
        cuts = tuple(cut for cut in logical if len(cut) <= size and not any(one < cut for one in found))
        new = [cut for cut in cuts if len(cut) == size]
        parts = [
            Part(
                spec,
                function,
                named,
                size,
                first,
                min(_SETS_IN_A_PART, comb(len(named), size) - first),
                (*found, *cuts),
            )
            for first in range(0, comb(len(named), size), _SETS_IN_A_PART)
        ]
        for part, sets in _answers(parts, executor, journal):
            new += sets
            advance(part.count)
        found += new
    return tuple(found)


def most_useful_jobs(sets: int) -> int:
    """Return the most processes that make a search of so many fault sets faster than one process is."""
    return max(1, sets // (_PROCESS_PAYS * _SETS_IN_A_PART))


def set_count(elements: int, order: int) -> int:
    """Return the number of fault sets of up to `order` of so many elements, the empty set included."""
    return sum(comb(elements, size) for size in range(min(order, elements) + 1))


def _answers(
    parts: list[Part], executor: Executor | None, journal: Journal | None
) -> Iterator[tuple[Part, list[FaultSet]]]:
    known = {} if journal is None else journal.known
    open_parts = [part for part in parts if (part.size, part.first) not in known]
    for part in parts:
        if (part.size, part.first) in known:
            yield part, known[part.size, part.first]
    try:
        for part, sets in zip(open_parts, _losing(open_parts, executor), strict=True):
            if journal is not None:
                journal.add(part, sets)
            yield part, sets
    except (BrokenExecutor, CancelledError) as error:
        raise UserError("a worker process has ended or was killed; repeat the command") from error


def _losing(parts: list[Part], executor: Executor | None) -> Iterator[list[FaultSet]]:
    if executor is None:
        yield from map(losing, parts)
        return
    waiting = iter(parts)
    under_way: deque[Future[list[FaultSet]]] = deque()
    while True:
        with held_back():
            for part in waiting:
                under_way.append(executor.submit(losing, part))
                if len(under_way) >= _PARTS_AHEAD:
                    break
        if not under_way:
            return
        yield under_way.popleft().result()
