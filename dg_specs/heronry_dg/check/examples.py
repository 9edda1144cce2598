"""Makes whole specs from the examples of rules.

An example is a fragment, which is merged into a small spec that has no findings. A fragment holds top-level keys and
their values; each key replaces the key of that name in `SOUND`, or is added at the end. A fragment that has a `dg` key,
or no key at all, is a whole file by itself. Bytes that are not UTF-8 are written as surrogate escapes.
"""

import re
from typing import Final

SOUND: Final = """\
dg: 1
buses: {can0: {bitrate: 1000000}}
pes:
  nav: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}
  tail: {node_id: 93, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}
devices:
  gps: {kind: sensor, pe: nav}
  lamp: {kind: actuator, pe: tail}
variables:
  speed: {type: FLOAT}
modules:
  driver: {device: gps, gives: {speed: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  display: {device: lamp, needs: speed, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions:
  showing: {output: display}
"""

_KEY: Final = re.compile(r"^(?=[A-Za-z_]+:)", re.MULTILINE)


def whole_spec(fragment: str) -> bytes:
    """Return the bytes of a whole spec made from a fragment."""
    head, *own = _KEY.split(fragment)
    sections = {_key(section): section for section in own}
    if not own or "dg" in sections or head.startswith(("%", "---")):
        return fragment.encode("utf-8", "surrogateescape")
    base = {_key(section): section for section in _KEY.split(SOUND) if section}
    return (head + "".join({**base, **sections}.values())).encode("utf-8", "surrogateescape")


def _key(section: str) -> str:
    return section.partition(":")[0]
