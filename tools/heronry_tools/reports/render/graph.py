"""The dependency graph as nodes and edges: the content of a picture, without the places of the symbols.

There are symbols for modules, variables, devices, and the four gates. Source of the symbols: section 3.1 and Figures 1
to 3 of the paper by Rawashdeh et al. (docs/semantics.md names the paper).

`build` makes a Graph of a spec; `ranks`, `ordering` and `layout` place its symbols; `svg` and `text` write it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal["module", "variable", "sensor", "actuator", "and", "or", "xor", "demux"]


@dataclass(frozen=True, slots=True)
class Cell:
    """One mode of a module, as it is drawn.

    dead: the mode cannot run.
    chosen: the mode runs in the plan.
    """

    label: str
    dead: bool = False
    chosen: bool = False


@dataclass(frozen=True, slots=True)
class Node:
    """One symbol. `key` is unique: `module:NAME`, `variable:NAME`, `gate:MODULE/MODE/PATH`, ..."""

    key: str
    kind: Kind
    label: str  # the name, or what stands in the symbol of a gate
    note: str = ""  # a note below the name, in smaller letters
    cells: tuple[Cell, ...] = ()  # modes of a module that has more than one
    again: bool = False  # a variable that is drawn dashed here, and solid on another sheet
    initial: bool = False  # a variable that has a value before it is received: a cycle may pass through it
    dead: bool = False  # cannot run, hold or be given
    chosen: bool = False  # runs, holds or is given in the plan


@dataclass(frozen=True, slots=True)
class Edge:
    """One flow of data, from left to right."""

    source: str
    target: str
    label: str = ""  # the versions that flow; empty: all versions
    out_cell: int | None = None  # the mode from which the edge comes; None: from the symbol itself
    in_cell: int | None = None
    dead: bool = False
    chosen: bool = False


@dataclass(frozen=True, slots=True)
class Graph:
    """A dependency graph as nodes and edges, both in the order of the spec."""

    name: str
    nodes: Mapping[str, Node]
    edges: tuple[Edge, ...]
