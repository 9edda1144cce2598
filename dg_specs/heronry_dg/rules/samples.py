"""Sections and lines of a spec for the examples of rules; they fit the small correct spec of check/examples.py."""

from typing import Final

RUNS: Final = "cpu: 0.1, ram: 1KiB, rate_hz: 10"  # the fields that every mode must have
DRIVER: Final = f"  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
ROOM: Final = "plants:\n  room: {moved_by: [lamp, second_lamp], seen_by: [gps, pitot], criticality: A}\n"
DISPLAY: Final = f"  display: {{device: lamp, needs: speed, {RUNS}}}\n"


def pes(
    nav: str = "node_id: 92, buses: [can0]", tail: str = "node_id: 93, buses: [can0]", *, nav_ram: str = "64KiB"
) -> str:
    """Return the section `pes`: the PEs `nav` and `tail`, with enough capacity for the examples.

    nav, tail: node-ID and buses of each PE, as in a spec. nav_ram: the RAM of PE `nav`.
    """
    return (
        f"pes:\n  nav: {{{nav}, cpu: 1, ram: {nav_ram}, flash: 64KiB}}\n"
        f"  tail: {{{tail}, cpu: 1, ram: 64KiB, flash: 64KiB}}\n"
    )


def doubled(criticality: str, *, pitot_pe: str = "tail", middle: str = "", reads: str = "speed") -> str:
    """Write a spec with two sensors and their drivers, two lamps that a DEMUX chooses between, and a replicated bus.

    criticality: the class of the spec's only function.
    pitot_pe: the PE of the second sensor.
    middle: modules between the drivers and the lamps; they read `speed`, and give `level`.
    reads: the variable that the lamps show.
    """
    level = "  level: {type: FLOAT}\n" if middle else ""
    return (
        "buses: {can0: {bitrate: 1000000, channels: 2}}\n"
        f"devices:\n  gps: {{kind: sensor, pe: nav}}\n  pitot: {{kind: sensor, pe: {pitot_pe}}}\n"
        "  lamp: {kind: actuator, pe: tail}\n  second_lamp: {kind: actuator, pe: nav}\n"
        f"variables:\n  speed: {{type: FLOAT}}\n{level}"
        f"gates: {{light: {{demux: {reads}}}}}\n"
        f"modules:\n{DRIVER}"
        f"  other_driver: {{device: pitot, gives: {{speed: 1}}, {RUNS}}}\n{middle}"
        f"  display: {{device: lamp, needs: light, {RUNS}}}\n"
        f"  second_display: {{device: second_lamp, needs: light, {RUNS}}}\n"
        f"functions: {{showing: {{output: light, criticality: {criticality}}}}}\n"
    )
