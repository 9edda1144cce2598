"""python-can, imported without asammdf.

Where asammdf is installed, `import can` imports it, and pandas with it, to read measurement files. That takes half a
second of processor time in every process of a system, and no process here reads such files by python-can. So asammdf is
hidden during the import. Every module of this project takes python-can from here. A program that has imported
python-can or asammdf before is left as it is.
"""

import sys

_UNNEEDED = "asammdf"

_is_hidden = not {"can", _UNNEEDED} & sys.modules.keys()
if _is_hidden:
    sys.modules[_UNNEEDED] = None  # type: ignore[assignment]  # it cannot be imported while this stands
try:
    import can
    import can.cli
    import can.typechecking
finally:
    if _is_hidden:
        del sys.modules[_UNNEEDED]

__all__ = ["can"]
