"""Flight code with one defect, imported into a process that has imported everything without it.

A module depends on its own text and on its imports alone. So the mutated module and all modules that import it,
directly or not, are removed from `sys.modules`, and the next import loads them again; the other modules stay, with
their state.
"""

import ast
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType

OURS = ("heronry_wire", "heronry_dg", "heronry_agent", "heronry_manager", "heronry_tools", "lab")


def dependents(name: str, imports: Mapping[str, set[str]]) -> set[str]:
    """Return the modules that import this one, directly or not, and itself."""
    found, new = {name}, {name}
    while new:
        new = {module for module, imported in imports.items() if imported & new} - found
        found |= new
    return found


def imports_of_ours() -> dict[str, set[str]]:
    """Return the imports of every imported module of this repository."""
    loaded = {name: module for name, module in sys.modules.items() if name.partition(".")[0] in OURS}
    return {name: set(_imported(module)) for name, module in loaded.items() if module.__file__}


def _imported(module: ModuleType) -> Iterator[str]:
    assert module.__file__ is not None
    for node in ast.parse(Path(module.__file__).read_bytes()).body:
        match node:
            case ast.Import(names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(str(source), names):
                yield source
                yield from (f"{source}.{alias.name}" for alias in names)


def take_in(name: str, file: Path, source: bytes, forgotten: set[str]) -> None:
    """Let the next import of a module read this text, and remove all modules that must be imported again."""
    sys.meta_path.insert(0, _Finder(name, file, compile(source, str(file), "exec", dont_inherit=True)))
    for module in forgotten & sys.modules.keys():
        del sys.modules[module]
        package, _, last = module.rpartition(".")
        vars(sys.modules.get(package, ModuleType(package))).pop(last, None)


class _Finder(MetaPathFinder):
    """Finds the mutated module."""

    def __init__(self, name: str, file: Path, code: CodeType) -> None:
        self._name, self._file, self._code = name, file, code

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002 - there is one
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """Return the module with the defect, None for other names."""
        if fullname != self._name:
            return None
        return spec_from_file_location(fullname, self._file, loader=_Loader(fullname, str(self._file), self._code))


class _Loader(SourceFileLoader):
    """Loads code that was compiled before."""

    def __init__(self, name: str, path: str, code: CodeType) -> None:
        super().__init__(name, path)
        self._code = code

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - there is one
        """Return the compiled code."""
        return self._code
