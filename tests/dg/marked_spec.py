"""Small specs with a mark before each place that the loader must complain about.

A test writes the mistake into a sound spec and puts `»` in front of it: `{node_id: »91, ...}`. `complaints` takes the
marks out, loads, and holds the places of the findings against the marks, all of them and no others.
"""

from heronry_dg.findings import Finding, Place, SpecError
from heronry_dg.loader import loads

MARK = "»"
RUNS = "cpu: 0.1, ram: 1KiB, rate_hz: 10"  # what every mode must say

SOUND = {
    "dg": "1",
    "buses": "{can0: {bitrate: 1000000}}",
    "pes": "{nav: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}}",
    "devices": "{gps: {kind: sensor, pe: nav}}",
    "variables": "{altitude: {type: FLOAT, versions: 3}, command: {type: UCHAR}}",
    "modules": f"{{driver: {{device: gps, gives: {{altitude: 1}}, {RUNS}}}}}",
    "functions": "{driving: {output: driver}}",
    "phases": "{climb: , land: }",
}


def spec_text(**sections: str) -> str:
    """A sound spec with some sections replaced or added, one line each."""
    marked = {key.removeprefix(MARK): key for key in sections}
    texts = {**SOUND, **{key.removeprefix(MARK): text for key, text in sections.items()}}
    return "".join(f"{marked.get(key, key)}: {text}\n" for key, text in texts.items())


def complaints(marked: str) -> list[str]:
    """The loader's sentences about a spec, without places and codes; the places must be those of the marks."""
    lines = marked.split("\n")
    marks = [
        Place(number, column - before)
        for number, line in enumerate(lines, start=1)
        for before, column in enumerate(i for i, c in enumerate(line, start=1) if c == MARK)
    ]
    found = findings(marked.replace(MARK, ""))
    assert [finding.place for finding in found] == marks, "\n".join(map(str, found))
    return [str(finding).split(" error: ", 1)[1] for finding in found]


def findings(text: str) -> tuple[Finding, ...]:
    """What the loader finds; nothing for a sound spec."""
    try:
        loads(text, "test.dg.yaml")
    except SpecError as error:
        return error.findings
    return ()


def complaint(marked: str) -> str:
    """The only sentence of the loader about a spec."""
    (only,) = complaints(marked)
    return only
