"""Imports python-can without what it does not need here; every other file of this project takes python-can from here.

Where asammdf is installed, `import can` imports it, and pandas with it, to read measurement files. This takes half a
second of processor time in every process of a system, and no process here reads such files by python-can. asyncio, with
OpenSSL below it, is a tenth of the memory of an agent, and python-can needs it only for listeners that are coroutines;
it needs sqlite3 for logs in data bases, and wrapt for a bus that several threads share. So this file hides asammdf and
wrapt during the import, and lets python-can import the two others when it first asks for something of them. If the
program has already imported python-can or one of these, that is not hidden.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Stands for a module until something of it is asked for."""

    AbstractEventLoop = Connection = object  # python-can names them in annotations

    def __getattr__(self, name: str) -> Any:
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(import_module(self.__name__), name)


_stand_ins: dict[str, ModuleType | None] = {
    "asammdf": None,  # its import fails
    "asyncio": _Later("asyncio"),
    "sqlite3": _Later("sqlite3"),
    "wrapt": None,
}
_hidden = {} if "can" in sys.modules else {k: one for k, one in _stand_ins.items() if k not in sys.modules}
sys.modules.update(_hidden)  # type: ignore[arg-type]
try:
    import can
    import can.cli
    import can.typechecking
finally:
    for _name, _one in _hidden.items():
        if sys.modules.get(_name, _name) is _one:
            del sys.modules[_name]

__all__ = ["can"]
