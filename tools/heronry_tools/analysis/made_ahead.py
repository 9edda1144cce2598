"""The plans made ahead with which an aircraft flies: those of a file, those for every single fault, or none.

*Which plans.* The user may name a file of plans, or `none`. Otherwise the plans are those for every single fault, in
the phases that the spec's `contingency` names.

*The same plans for all.* The manager refers to a contingency by its number, and a PE has its slice of that contingency
on board (protocol rule 5). So the tables and the manager need the same plans. The same spec, planner and processor
architecture give the same plans, so tables and manager may be prepared on different computers. Even if the plans
differ, no PE runs another configuration than the manager commands: PREPARE has a digest that the PE does not hold, the
PE answers that the contingency is not on board, and the manager sends the slice.

*When they are made.* The plans are made when they are first needed. (A demo does not wait for them: it makes them in
the background.) They are kept in a file of the user's cache, under the digests of the spec and of the planner, so that
a manager that starts again in flight finds them. A lock ensures that only one process makes the plans. If that process
is killed, the next process continues its work (`contingency.journal`). The file is written whole or not at all, and a
damaged file is made anew.

If the plans cannot be made or kept, a message says so, and the system flies without them.
"""

import fcntl
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Final

import heronry_dg
import heronry_manager
from heronry_dg.model import Spec
from heronry_dg.situation import elements
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.contingency.file_format import ContingencyFileError, read_contingencies
from heronry_manager.planner.sweep import Scope
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.scope import cpus, phases_of
from heronry_tools.analysis.campaign.sweeping import partial_of, sweep_into
from heronry_tools.console.contingencies_argument import Ahead, Source
from heronry_tools.console.user_cache import digest_of, user_cache
from heronry_wire.errors import HeronryError

_FAULTS: Final = 1
_QUESTIONS_FOR_A_CREW: Final = 100  # fewer plans are made sooner than worker processes start


def contingencies_of(
    spec: Spec, source: Source, before_making: Callable[[], None] = lambda: None, workers: int | None = None
) -> Contingencies | None:
    """Return the plans made ahead for a spec, and make them now if needed; None if none are wanted or possible.

    before_making: called before planning, which takes minutes; it may raise an error that the user should see first.
    workers: the number of processes that plan; None: one for each processor, or this process if there are few plans.
    Raises ContingencyFileError for a file that is not of this spec, OSError for a file that cannot be read.
    """
    if isinstance(source, Path):
        return read_contingencies(source, spec)
    return None if source is Ahead.NOTHING else _single_faults(spec, before_making, workers)


def kept_contingencies(spec: Spec) -> Contingencies | None:
    """Return the plans for every single fault from the user's cache.

    None if the cache has no plans that this planner made for this spec with this solver.
    """
    return _kept(spec, _kept_in(spec))


def can_plan_ahead() -> bool:
    """Tell whether the solver is installed; if not, print a message on stderr."""
    if _solver() is None:
        _say('nothing is planned ahead without ortools; add it with: pip install "heronry[manager]"')
        return False
    return True


def questions(spec: Spec) -> int:
    """Return the number of plans to make: in each phase one for the healthy system, and one for each single fault.

    Plans for places are not counted. (A plan for a place is for the failure of a module on one PE.)
    """
    scope = _scope(spec)
    return scope.set_count() * len(scope.phases)


def found_so_far(spec: Spec) -> int:
    """Return the number of plans in the journal of a sweep that has not been completed; 0 without a journal."""
    with suppress(OSError):
        lines = partial_of(_kept_in(spec)).read_bytes().count(b"\n")
        return max(0, lines - 1)  # the first line is no plan
    return 0


def _solver() -> str | None:
    """Return the version of the solver; None if it is not installed."""
    try:
        return str(import_module("ortools").__version__)
    except ModuleNotFoundError:
        return None


def _single_faults(spec: Spec, before_making: Callable[[], None], workers: int | None) -> Contingencies | None:
    if not can_plan_ahead():
        return None
    file = _kept_in(spec)
    kept = _kept(spec, file)
    if kept is not None:
        return kept
    before_making()
    try:
        return _made(spec, file, workers)
    except OSError as error:
        why = f"{file.parent} cannot be written ({error.strerror}); set XDG_CACHE_HOME to a folder of yours"
    except HeronryError as error:
        why = str(error)
    _say(f"nothing is planned ahead: {why}")
    return None


def _say(sentence: str) -> None:
    with suppress(OSError):  # a full disk under the log must not end the flight
        print(f"heronry: {sentence}", file=sys.stderr)


def _kept_in(spec: Spec) -> Path:
    """Return the file for the plans of a spec; its name has a digest of all that the plans depend on."""
    digest = digest_of(f"{spec.digest} ortools {_solver()} {platform.machine()}", _planner())
    return user_cache("contingencies") / f"{spec.name}-{digest}.contingencies"


def _planner() -> Iterator[tuple[str, Path]]:
    """Yield the source files on which a plan and the format of its file depend, each with its name."""
    for package in (heronry_dg, heronry_manager):
        home = Path(str(package.__file__)).parent
        yield from ((file.relative_to(home.parent).as_posix(), file) for file in sorted(home.rglob("*.py")))


def _kept(spec: Spec, file: Path) -> Contingencies | None:
    """Read the plans of a file; None where it is missing, damaged, or of another spec."""
    with suppress(OSError, ContingencyFileError):
        return read_contingencies(file, spec)
    return None


def _made(spec: Spec, file: Path, workers: int | None) -> Contingencies:
    """Make the plans of a spec ahead, write them to `file`, and return them; or read them if `file` has them.

    If another process is planning ahead, wait until it has finished, and then look into the file.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with (file.parent / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _say("waiting for another process that plans ahead")
            fcntl.flock(lock, fcntl.LOCK_EX)
        return _kept(spec, file) or _make(spec, file, workers)


def _make(spec: Spec, file: Path, workers: int | None) -> Contingencies:
    count = questions(spec)
    _say(f"planning {spec.name} ahead for every single fault, once ({count} plans, and those of places in use)")
    with crew(workers or (cpus() if count > _QUESTIONS_FOR_A_CREW else 1)) as executor:
        return sweep_into(file, spec, _scope(spec), executor).made


def _scope(spec: Spec) -> Scope:
    """Return the scope of the plans made ahead: the elements that may fail, how many at once (0 or 1), the phases.

    With 1, each place that a fault-free plan uses may fail, too.
    """
    return Scope(elements(spec), min(_FAULTS, spec.contingency.faults), phases_of(spec), places=True)
