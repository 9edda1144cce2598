"""All conformance tests, by name: FILE.TEST. Every public function of one of the files is a test."""

from collections.abc import Callable, Iterator, Mapping
from inspect import isfunction
from types import ModuleType

from lab.conformance import (
    manager_counting,
    manager_epochs,
    manager_reacting,
    manager_standing_by,
    manager_telling,
    pe_accepting,
    pe_alone,
    pe_answering,
    pe_between,
    pe_failing,
    pe_keyed,
    pe_serving,
    pe_silence,
    pe_speaking,
    pe_staging,
    pe_stepping,
    pe_telling,
    player,
)

ConformanceTest = Callable[[], None]
_FILES = (
    pe_speaking,
    pe_accepting,
    pe_serving,
    pe_answering,
    pe_staging,
    pe_stepping,
    pe_telling,
    pe_failing,
    pe_silence,
    pe_between,
    pe_alone,
    pe_keyed,
    manager_counting,
    manager_epochs,
    manager_reacting,
    manager_standing_by,
    manager_telling,
)


def _tests_of(file: ModuleType) -> Iterator[ConformanceTest]:
    """Yield every public function of a file, in the order of the file."""
    for name, found in vars(file).items():
        if isfunction(found) and found.__module__ == file.__name__ and not name.startswith("_"):
            yield found


CONFORMANCE_TESTS: Mapping[str, ConformanceTest] = {
    f"{file.__name__.rpartition('.')[2]}.{conformance_test.__name__}": conformance_test
    for file in _FILES
    for conformance_test in _tests_of(file)
}


def conforms(name: str) -> tuple[str | None, str]:
    """Run a conformance test; gives what went wrong (None: nothing), and a digest of all frames."""
    said = player.begin()
    try:
        CONFORMANCE_TESTS[name]()
    except Exception as error:  # noqa: BLE001 - any exception of a core is a result of the test
        return f"{type(error).__name__}: {error}".partition("\n")[0][:200], said.so_far()
    return None, said.so_far()
