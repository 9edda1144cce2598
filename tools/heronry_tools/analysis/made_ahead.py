"""Which plans made ahead an aircraft flies with: those of a file, those for every single fault, or none.

The manager calls a contingency by its number, and a PE has its slice of it on board (rule 5): who compiles the tables
and who starts a manager must mean the same plans. A file says which. Where none is named, both make those for every
single fault, in the phases that the spec's `contingency` names. Same spec, same planner, same processor architecture:
same plans, so the two may sit on different computers. Where they do come out differently, the digest in PREPARE is
another one, the PE says that it has no such contingency, and gets its slice: nobody runs what was not meant.

They are made once, when they are needed first, and kept in the user's cache under the digests of the spec and of the
planner; so a manager that starts again in flight finds them. Nobody else makes them meanwhile (a lock), a killed run is
gone on with (`contingency.journal`), a file is there whole or not at all, and one that is damaged is made anew. Where
they cannot be made or kept, that is said, and nothing is planned ahead: it is no reason not to fly.
"""

import argparse
import fcntl
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from heronry_tools.console.user_cache import digest_of, user_cache
from heronry_wire.errors import HeronryError

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_manager.contingency.contingencies import Contingencies

SINGLE_FAULTS_KEPT: Final = "those for every single fault, made when they are needed first, and kept"
_FAULTS: Final = 1
_QUESTIONS_FOR_A_CREW: Final = 100  # fewer are answered here before a crew of processes has come


class Ahead(Enum):
    """What is made ahead where no file says so."""

    SINGLE_FAULTS = "the plans for every single fault"
    NOTHING = "none"


Source = Path | Ahead

CARRIED = "of which what fits is put on board, and with which the manager must fly too"
"""What the plans are for where tables are compiled."""


def add_contingencies_argument(parser: argparse.ArgumentParser, what: str, default: str = SINGLE_FAULTS_KEPT) -> None:
    """Add --contingencies: `what` the plans are for, and which are taken where nothing is said."""
    parser.add_argument(
        "--contingencies",
        type=_source,
        default=Ahead.SINGLE_FAULTS,
        metavar="FILE",
        help=f"plans made ahead, {what}: a file of 'heronry contingencies', or 'none' (default: {default})",
    )


def _source(text: str) -> Source:
    return Ahead.NOTHING if text == Ahead.NOTHING.value else Path(text)


def contingencies_of(
    spec: "Spec", source: Source, before_making: Callable[[], None] = lambda: None
) -> "Contingencies | None":
    """Plans made ahead for a spec, made now if need be; None where there are to be none, or can be none.

    before_making: called before what may take minutes, to raise what can be known by then.
    Raises ContingencyFileError for a file that is none of this spec, OSError for one that cannot be read.
    """
    from heronry_manager.contingency.file_format import read_contingencies  # noqa: PLC0415 - keeps `--help` quick

    if isinstance(source, Path):
        return read_contingencies(source, spec)
    return None if source is Ahead.NOTHING else _single_faults(spec, before_making)


def _single_faults(spec: "Spec", before_making: Callable[[], None]) -> "Contingencies | None":
    try:
        solver = import_module("ortools").__version__
    except ModuleNotFoundError:
        _say('nothing is planned ahead without ortools; add it with: pip install "heronry[manager]"')
        return None
    file = _kept_in(spec, solver)
    kept = _kept(spec, file)
    if kept is not None:
        return kept
    before_making()
    try:
        return _made(spec, file)
    except OSError as error:
        why = f"{file.parent} cannot be written ({error.strerror}); set XDG_CACHE_HOME to a folder of yours"
    except HeronryError as error:
        why = str(error)
    _say(f"nothing is planned ahead: {why}")
    return None


def _say(sentence: str) -> None:
    with suppress(OSError):  # a full disk under the log is no reason not to fly
        print(f"heronry: {sentence}", file=sys.stderr)


def _kept_in(spec: "Spec", solver: str) -> Path:
    """Where the plans of a spec are, or would be: by all that they depend on."""
    digest = digest_of(f"{spec.digest} ortools {solver} {platform.machine()}", _planner())
    return user_cache("contingencies") / f"{spec.name}-{digest}.contingencies"


def _planner() -> Iterator[tuple[str, Path]]:
    """Sources that a plan depends on, and the file's format."""
    import heronry_dg  # noqa: PLC0415
    import heronry_manager  # noqa: PLC0415

    for package in (heronry_dg, heronry_manager):
        home = Path(str(package.__file__)).parent
        yield from ((file.relative_to(home.parent).as_posix(), file) for file in sorted(home.rglob("*.py")))


def _kept(spec: "Spec", file: Path) -> "Contingencies | None":
    """Read the file; None where it is not there, or damaged."""
    from heronry_manager.contingency.file_format import ContingencyFileError, read_contingencies  # noqa: PLC0415

    with suppress(OSError, ContingencyFileError):
        return read_contingencies(file, spec)
    return None


def _made(spec: "Spec", file: Path) -> "Contingencies":
    """Make the file, unless another process has made it while this one waited."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with (file.parent / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _say("waiting for another process that plans ahead")
            fcntl.flock(lock, fcntl.LOCK_EX)
        return _kept(spec, file) or _make(spec, file)


def _make(spec: "Spec", file: Path) -> "Contingencies":
    from heronry_dg.situation import elements  # noqa: PLC0415
    from heronry_manager.planner.sweep import Scope  # noqa: PLC0415
    from heronry_tools.analysis.campaign.crew import crew  # noqa: PLC0415
    from heronry_tools.analysis.campaign.scope import cpus, phases_of  # noqa: PLC0415
    from heronry_tools.analysis.campaign.sweeping import sweep_into  # noqa: PLC0415

    scope = Scope(elements(spec), min(_FAULTS, spec.contingency.faults), phases_of(spec))
    questions = scope.set_count() * len(scope.phases)
    _say(f"planning {spec.name} ahead for every single fault, once ({questions} plans)")
    with crew(cpus() if questions > _QUESTIONS_FOR_A_CREW else 1) as executor:
        return sweep_into(file, spec, scope, executor).made
