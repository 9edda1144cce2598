"""Imports python-can without asammdf; every other file of this project takes python-can from here.

Where asammdf is installed, `import can` imports it, and pandas with it, to read measurement files. This takes half a
second of processor time in every process of a system, and no process here reads such files by python-can. So this file
hides asammdf during the import. If the program has already imported python-can or asammdf, nothing is hidden.
"""

import sys

_UNNEEDED = "asammdf"

_is_hidden = not {"can", _UNNEEDED} & sys.modules.keys()
if _is_hidden:
    sys.modules[_UNNEEDED] = None  # type: ignore[assignment]  # with this entry, an import of asammdf fails
try:
    import can
    import can.cli
    import can.typechecking
finally:
    if _is_hidden:
        del sys.modules[_UNNEEDED]

__all__ = ["can"]
