"""The JSON schema of a snapshot, made from its data classes.

The file snapshot.schema.json in this folder has the same text, for programs in other languages.
"""

import json
from pathlib import Path

from pydantic import TypeAdapter

from heronry_tools.watch.snapshot import VERSION, Snapshot

SCHEMA_FILE = Path(__file__).with_name("snapshot.schema.json")


def schema_text() -> str:
    """Write the schema of this version's snapshots (draft 2020-12)."""
    made = TypeAdapter(Snapshot).json_schema(mode="serialization")
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"heronry snapshot, version {VERSION}",
    }
    return json.dumps({**head, **{key: value for key, value in made.items() if key != "title"}}, indent=2) + "\n"
