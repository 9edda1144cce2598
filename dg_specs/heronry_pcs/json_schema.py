"""The JSON schema of `*.pcs.yaml` (draft 7), for editors; it does not check whether names refer to something."""

import json
from typing import Any, Final

_NAME: Final = r"^[^\s.,'\"\\]{1,128}$"
_PORT: Final = r"^[^\s,'\"\\]{1,128}$"
_TEXT: Final[dict[str, Any]] = {"type": ["string", "null"], "minLength": 1}
_PORTS: Final[dict[str, Any]] = {
    "description": "Its ports: a list of names, or a map from each name to its weight in bit/s.",
    "examples": [["a", "b"], {"m_alt": 9500}],
    "anyOf": [
        {"type": "array", "items": {"type": "string", "pattern": _PORT}, "minItems": 1, "uniqueItems": True},
        {
            "type": "object",
            "propertyNames": {"pattern": _PORT},
            "additionalProperties": {"type": ["number", "null"], "minimum": 0},
            "minProperties": 1,
        },
    ],
}
_LEAF: Final[dict[str, Any]] = {
    "type": "object",
    "description": "A component without components.",
    "properties": {
        "ports": _PORTS,
        "image": {**_TEXT, "description": "Its code; its name if left out.", "examples": ["pcstrackingfilter.dll"]},
        "plant": {
            "type": ["boolean", "null"],
            "description": "Whether it is a part of the physical world.",
            "default": False,
        },
        "side": {**_TEXT, "description": "The side of a cut that it is pinned to.", "examples": ["uav"]},
        "components": {"type": "null"},
    },
    "required": ["ports"],
    "additionalProperties": False,
}
_COMPOSITE: Final[dict[str, Any]] = {
    "type": "object",
    "description": "A component of components.",
    "properties": {
        "components": {"$ref": "#/definitions/Components"},
        **{field: {"type": "null"} for field in ("ports", "image", "plant", "side")},
    },
    "required": ["components"],
    "additionalProperties": False,
}
_HAS_COMPONENTS: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["components"],
    "properties": {"components": {"not": {"type": "null"}}},
}


def graph_schema() -> dict[str, Any]:
    """Return the JSON schema of a file with a component graph."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Component graph of heronry (pcs: 1)",
        "type": "object",
        "properties": {
            "pcs": {"const": 1, "description": "Version of this format."},
            "name": {**_TEXT, "description": "Name of the graph; the file's name if left out.", "examples": ["g_eav"]},
            "components": {
                "description": "Members of the graph, at any depth.",
                "anyOf": [{"$ref": "#/definitions/Components"}, {"type": "null"}],
            },
            "edges": {
                "type": ["array", "null"],
                "description": "Edges from port to port.",
                "items": {"type": "string", "pattern": r"^\s*\S+\s*->\s*\S+\s*$"},
                "uniqueItems": True,
                "examples": [["Kc1.a -> Kc2.a"]],
            },
            "library": {
                "type": ["object", "null"],
                "description": "Leaves that are in the space and not in the graph.",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": {"$ref": "#/definitions/Leaf"},
            },
        },
        "required": ["pcs"],
        "additionalProperties": False,
        "definitions": {
            "Leaf": _LEAF,
            "Composite": _COMPOSITE,
            "Components": {
                "type": "object",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": {
                    "if": _HAS_COMPONENTS,
                    "then": {"$ref": "#/definitions/Composite"},
                    "else": {"$ref": "#/definitions/Leaf"},
                },
            },
        },
    }


def schema_text() -> str:
    """The schema as the file pcs.schema.json has it."""
    return json.dumps(graph_schema(), indent=2, ensure_ascii=False) + "\n"
