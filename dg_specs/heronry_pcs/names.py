"""Which texts may be the name of a component or of a port.

A vertex is `leaf.port`, split at the first dot. On a command line a list separates names by commas, and an edge is
written `A.a -> B.b`. So the name of a component has no dot, and no name has white space, commas, quotes or an arrow.
Names are shown on a terminal, so each character is one that can be printed.
"""

import re
from typing import Final

_COMPONENT: Final = re.compile(r"(?!.*->)[^\s.,'\"\\]{1,128}")
_PORT: Final = re.compile(r"(?!.*->)[^\s,'\"\\]{1,128}")
_EDGE: Final = re.compile(r"\s*(?P<start>\S+?)\s*->\s*(?P<end>\S+)\s*")

COMPONENT_HINT: Final = "use at most 128 letters, digits, '_' and ':', and no dot"
PORT_HINT: Final = "use at most 128 letters, digits, '_', ':' and '.'"
EDGE_HINT: Final = "write A.a -> B.b"


def is_component(name: str) -> bool:
    """Tell whether a text may be the name of a component."""
    return name.isprintable() and _COMPONENT.fullmatch(name) is not None


def is_port(name: str) -> bool:
    """Tell whether a text may be the name of a port."""
    return name.isprintable() and _PORT.fullmatch(name) is not None


def edge_of(text: str) -> tuple[str, str] | None:
    """Return the two vertices of an edge written `A.a -> B.b`; None where the text is no edge."""
    match = _EDGE.fullmatch(text)
    return (match["start"], match["end"]) if match is not None else None
