"""What may be the name of a component or of a port.

A vertex is `leaf.port`, split at the first dot; lists on a command line separate names by commas, and an edge is
written `A.a -> B.b`. So a component has no dot in its name, and neither it nor a port has white space, commas, quotes
or an arrow.
"""

import re
from typing import Final

_COMPONENT: Final = re.compile(r"(?!.*->)[^\s.,'\"\\]{1,128}")
_PORT: Final = re.compile(r"(?!.*->)[^\s,'\"\\]{1,128}")
_EDGE: Final = re.compile(r"\s*(?P<start>\S+?)\s*->\s*(?P<end>\S+)\s*")

COMPONENT_HINT: Final = "use letters, digits, '_' and ':', and no dot"
PORT_HINT: Final = "use letters, digits, '_', ':' and '.'"
EDGE_HINT: Final = "write A.a -> B.b"


def is_component(name: str) -> bool:
    """Tell whether a text may be the name of a component."""
    return _COMPONENT.fullmatch(name) is not None


def is_port(name: str) -> bool:
    """Tell whether a text may be the name of a port."""
    return _PORT.fullmatch(name) is not None


def edge_of(text: str) -> tuple[str, str] | None:
    """The two vertices of an edge written `A.a -> B.b`; None where it is none."""
    match = _EDGE.fullmatch(text)
    return (match["start"], match["end"]) if match is not None else None
