"""The JSON schema of a spec (draft 7). With it an editor completes fields, shows their meaning, and marks mistakes.

The schema is generated from the forms of schema.py. This file adds what those forms do not state: the form of gate
expressions, of initial values and of names. The schema accepts everything that the loader accepts, including a key
without a value. It does not check whether a name refers to something.
"""

import json
from collections.abc import Mapping
from typing import Any, Final

from heronry_dg.field_types import DEFAULT_PHASE, MOST_POINTS, NAME_PATTERN
from heronry_dg.model import THRESHOLDS, Demux
from heronry_dg.schema import form_of, spec_form

_DRAFT: Final = "http://json-schema.org/draft-07/schema#"
_NAME: Final = f"^{NAME_PATTERN}$"
_REFERENCE: Final = f"^{NAME_PATTERN}(@(<=)?[0-9]{{1,3}})?$"

_INPUTS: Final[Mapping[str, Any]] = {"type": "array", "minItems": 1, "items": {"$ref": "#/definitions/Expression"}}


def _gate(name: str, description: str, inside: Mapping[str, Any], example: Any) -> dict[str, Any]:
    field = {**inside, "description": description, "examples": [example]}
    return {
        "type": "object",
        "description": description,
        "properties": {name: field},
        "required": [name],
        "additionalProperties": False,
    }


_OR_FIELDS: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {
        "k": {
            "type": "integer",
            "minimum": 0,
            "description": "How many inputs must hold at least; with 0 all are optional.",
            "examples": [1],
        },
        "of": {**_INPUTS, "description": "The inputs.", "examples": [["altitude", "release_command"]]},
    },
    "required": ["k", "of"],
    "additionalProperties": False,
}
_INPUT: Final[Mapping[str, Any]] = {
    "type": "object",
    "description": "A variable with points of its own for its versions, or that is read in some phases only.",
    "properties": {
        "var": {
            "type": "string",
            "pattern": _REFERENCE,
            "description": "Variable, and which versions of it are accepted.",
            "examples": ["altitude", "altitude@<=2"],
        },
        "worth": {
            "type": ["array", "null"],
            "items": {"type": "integer", "minimum": 0, "maximum": MOST_POINTS},
            "description": "Points for each accepted version (or for each version of the variable), best first.",
            "examples": [[30, 10]],
        },
        "only_in": {
            "type": ["array", "null"],
            "items": {"type": "string"},
            "minItems": 1,
            "uniqueItems": True,
            "description": "Phases in which the input may be wired; all if left out.",
            "examples": [["glide"]],
        },
    },
    "required": ["var"],
    "additionalProperties": False,
}
_EXPRESSION: Final[Mapping[str, Any]] = {
    "description": "A gate expression: which inputs must be wired for the mode to run.",
    "anyOf": [
        {
            "type": "string",
            "pattern": _REFERENCE,
            "description": "A variable: any version (NAME), version 2 (NAME@2), 2 or better (NAME@<=2); or a gate.",
            "examples": ["altitude", "altitude@2", "altitude@<=2", "elevator_out"],
        },
        _gate("and", "All inputs hold.", _INPUTS, ["pitch_angle", "roll_angle"]),
        _gate("or", "At least k inputs hold.", _OR_FIELDS, {"k": 1, "of": ["altitude", "release_command"]}),
        _gate("xor", "Exactly one input holds.", {**_INPUTS, "minItems": 2}, ["altitude@1", "altitude@2"]),
        _INPUT,
    ],
}
_INITIAL: Final[Mapping[str, Any]] = {
    "anyOf": [
        {"type": ["number", "string", "null"]},
        {"type": "array", "items": {"type": "integer"}, "minItems": 1, "maxItems": 4},
    ]
}
_NO_MODES: Final[Mapping[str, Any]] = {
    "type": "null",
    "description": "Modes by name; fields of a mode, such as `cpu`, then stand in each mode, not on the module.",
    "examples": [None],
}


def schema_text() -> str:
    """Return the content of the file dg.schema.json."""
    return json.dumps(spec_schema(), indent=2, ensure_ascii=False) + "\n"


def spec_schema() -> dict[str, Any]:
    """Return the schema of a whole spec."""
    schema = spec_form().model_json_schema(by_alias=True, ref_template="#/definitions/{model}")
    definitions = schema.pop("$defs")
    definitions["Expression"] = dict(_EXPRESSION)
    for part in (schema, *definitions.values()):
        _complete(part)
    _complete_sections(schema["properties"])
    definitions["DemuxForm"] = form_of(Demux).model_json_schema(by_alias=True)
    _complete(definitions["DemuxForm"])
    definitions["WhenForm"]["oneOf"] = [_number_given(name) for name in THRESHOLDS]
    definitions["ModuleOfOneModeForm"]["properties"]["modes"] = dict(_NO_MODES)
    return {"$schema": _DRAFT, "title": "Dependency graph of heronry (dg: 1)", **schema, "definitions": definitions}


def _complete_sections(sections: dict[str, Any]) -> None:
    """Add to the schemas of the sections `modules`, `gates` and `phases` what their entries must look like.

    The form of a module depends on the field `modes`, the form of a gate on the field `demux`.
    """
    sections["modules"]["additionalProperties"] = {
        "if": {"required": ["modes"], "properties": {"modes": {"not": {"type": "null"}}}},
        "then": {"$ref": "#/definitions/ModuleOfModesForm"},
        "else": {"$ref": "#/definitions/ModuleOfOneModeForm"},
    }
    sections["gates"]["additionalProperties"] = {
        "if": {"type": "object", "required": ["demux"]},
        "then": {"$ref": "#/definitions/DemuxForm"},
        "else": {"$ref": "#/definitions/Expression"},
    }
    sections["phases"]["propertyNames"] = {"pattern": _NAME, "not": {"const": DEFAULT_PHASE}}
    sections["phases"]["additionalProperties"] = {"anyOf": [{"$ref": "#/definitions/PhaseForm"}, {"type": "null"}]}


def _number_given(field: str) -> dict[str, Any]:
    return {"required": [field], "properties": {field: {"type": "number"}}}


def _complete(form: dict[str, Any]) -> None:
    """Complete the schema of a form, which pydantic has generated, in place.

    - The field `needs` accepts a gate expression or null, `demux` a gate expression, `initial` an initial value, and
      any other optional field also null.
    - The keys of a map must be names.
    - Titles, which only repeat a name, and defaults of None are removed.
    """
    form.pop("title", None)
    required = form.get("required", ())
    for name, field in form.get("properties", {}).items():
        _strip_titles(field)
        if field.get("default", 0) is None:
            del field["default"]
        if name == "needs":
            field["anyOf"] = [{"$ref": "#/definitions/Expression"}, {"type": "null"}]
        elif name == "demux":
            field["anyOf"] = [{"$ref": "#/definitions/Expression"}]
        elif name == "initial":
            field.update(_INITIAL)
        elif name not in required:
            _allow_nothing(field)
        if "additionalProperties" in field:
            field["propertyNames"] = {"pattern": _NAME}


def _strip_titles(node: Any) -> None:
    if isinstance(node, dict):
        node.pop("title", None)
        for child in node.values():
            _strip_titles(child)
    elif isinstance(node, list):
        for child in node:
            _strip_titles(child)


def _allow_nothing(field: dict[str, Any]) -> None:
    """Let a field accept null, because the loader accepts a key without a value."""
    if isinstance(field.get("type"), str):
        field["type"] = [field["type"], "null"]
        if "enum" in field:
            field["enum"] = [*field["enum"], None]
    elif "$ref" in field:
        field["anyOf"] = [{"$ref": field.pop("$ref")}, {"type": "null"}]
    elif "anyOf" in field and {"type": "null"} not in field["anyOf"]:
        field["anyOf"] = [*field["anyOf"], {"type": "null"}]
