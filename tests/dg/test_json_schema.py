"""The JSON schema for editors accepts what the loader accepts, and refuses what it can, field by field."""

import json
from typing import Any

import pytest
from jsonschema import Draft7Validator

from heronry_dg import yaml_source
from heronry_dg.check.examples import whole_spec
from heronry_dg.check.json_schema import spec_schema
from heronry_dg.findings import Findings
from heronry_dg.rules import graph, schema
from heronry_dg.rules.rule import Rule
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.analysis.check.registry import RULES

SCHEMA = spec_schema()
VALIDATOR = Draft7Validator(SCHEMA)

SEEN = [  # what a schema can see without knowing what names refer to
    *(schema.NOT_A_MAP, schema.UNKNOWN_FIELD, schema.MISSING_FIELD, schema.WRONG_TYPE, schema.NOT_A_CHOICE),
    *(schema.OUT_OF_RANGE, schema.BAD_NAME, schema.SHORT_LIST, schema.BAD_TEXT, schema.LISTED_TWICE),
    *(schema.WRONG_UNIT, schema.BAD_MEMORY, schema.NO_DEFAULT, schema.MODES_AND_FIELDS, schema.NO_MODE),
    *(schema.UNKNOWN_TYPE, graph.ARITY, graph.BAD_EXPRESSION, graph.UNKNOWN_GATE, schema.PHASE_NAMED_DEFAULT),
    schema.ONE_THRESHOLD,
]


def loaded(text: bytes) -> Any:
    """The file as JSON would have it."""
    tree = yaml_source.read_tree(text, Findings("x"))
    assert tree is not None
    return json.loads(json.dumps(yaml_source.plain(tree), default=float))


def test_it_is_a_schema_of_draft_7() -> None:
    Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", shipped_spec_names())
def test_shipped_specs_fit_and_name_their_schema(name: str) -> None:
    text = shipped_spec_path(name).read_bytes()
    assert [error.message for error in VALIDATOR.iter_errors(loaded(text))] == []
    assert text.startswith(b"# yaml-language-server: $schema=dg.schema.json\n")


GOOD = [rule for rule in RULES.values() if not rule.good.startswith("(")]


@pytest.mark.parametrize("rule", GOOD, ids=lambda rule: rule.code)
def test_every_good_example_fits(rule: Rule) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(loaded(whole_spec(rule.good)))] == []


@pytest.mark.parametrize("rule", SEEN, ids=lambda rule: rule.code)
def test_what_can_be_seen_without_names_is_marked_in_the_editor(rule: Rule) -> None:
    assert not VALIDATOR.is_valid(loaded(whole_spec(rule.bad)))


def test_every_field_is_described_with_an_example_that_fits() -> None:
    for form in (SCHEMA, *SCHEMA["definitions"].values()):
        for name, field in form.get("properties", {}).items():
            assert "description" in field, name
            assert field["description"].endswith("."), name
            validator = Draft7Validator({**field, "definitions": SCHEMA["definitions"]})
            assert field["examples"], name
            for example in field["examples"]:
                assert validator.is_valid(example), (name, example)


def test_a_key_without_a_value_counts_as_left_out_here_too() -> None:
    text = "dg: 1\nbuses: {can0: {bitrate: 1, kind: , rate_per_h: }}\nmanager:\npes:\n"
    text += "phases: {climb: }\nmodules: {a: {modes: , cpu: 1, ram: 1, rate_hz: 1}}\ncontingency:\n"
    assert [error.message for error in VALIDATOR.iter_errors(loaded(text.encode()))] == []
