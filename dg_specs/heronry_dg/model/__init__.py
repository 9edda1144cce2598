"""The model of a spec, as the loader gives it to all other code: immutable, checked and exact.

Quantities are integers: CPU in thousandths of a reference core, memory in bytes, rates in millihertz, bandwidth in
bit/s, times in nanoseconds. Shares (`max_load`, `reserve`) are exact fractions.

Mappings keep the order of the file, and that order carries meaning:

- The modes of a module are listed best first.
- The first phase is the initial one.
- The first branch of a DEMUX is its primary branch; with `to`, the first end is.
- Ties in the allocation of identifiers go to the earlier name.

The loader ensures of every `Spec`:

- Names are unique within their kind, and every name that is used exists.
- The buses form a forest: between two PEs there is at most one route.
- Every cycle of wires passes through a variable with an `initial` value.
- Every gate has a legal number of inputs.
- A DEMUX has at least two branches, and one end for each branch (`demux_paths`).

The elements also declare the keys of a spec: a field with a `Key` is a key of the file (see `keys`).
"""

from heronry_dg.model.fallible import Fallible
from heronry_dg.model.hardware import LAST_11_BIT_ID, LAST_29_BIT_ID, Bus, Device, Foreign, Manager, Pe, Plant
from heronry_dg.model.mission import THRESHOLDS, CommonCause, Contingency, Phase, When
from heronry_dg.model.software import Checkpoint, Demux, Function, Mode, Module, Variable
from heronry_dg.model.spec import Header, Spec

__all__ = [
    "LAST_11_BIT_ID",
    "LAST_29_BIT_ID",
    "THRESHOLDS",
    "Bus",
    "Checkpoint",
    "CommonCause",
    "Contingency",
    "Demux",
    "Device",
    "Fallible",
    "Foreign",
    "Function",
    "Header",
    "Manager",
    "Mode",
    "Module",
    "Pe",
    "Phase",
    "Plant",
    "Spec",
    "Variable",
    "When",
]
