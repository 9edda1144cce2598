"""What a node that waits for a table offers (object 2025h): one JSON object, in which nothing is believed unchecked.

    cores, ram_kib, disk_kib     whole numbers above 0
    version, python, machine     texts of one line
    images                       list of texts of one line

This file keeps no state. A text of any other form is no offer.
"""

import json
from typing import Any

_NUMBERS = ("cores", "ram_kib", "disk_kib")
_TEXTS = ("version", "python", "machine")


def read_offer(text: str) -> dict[str, Any] | None:
    """Return the offer of a node, or None if the text is none."""
    try:
        offer = json.loads(text)
    except ValueError:
        return None
    is_offer = (
        isinstance(offer, dict)
        and all(type(offer.get(name)) is int and offer[name] > 0 for name in _NUMBERS)
        and all(isinstance(offer.get(name), str) and offer[name].isprintable() for name in _TEXTS)
        and isinstance(offer.get("images"), list)
        and all(isinstance(image, str) and image.isprintable() for image in offer["images"])
    )
    return {name: offer[name] for name in (*_NUMBERS, *_TEXTS, "images")} if is_offer else None


def adopts(spec: str, node: int) -> str:
    """Return the command that writes the lines of a spec for a node."""
    return f"heronry adopt {spec} {node}"


def hardware(offer: dict[str, Any]) -> str:
    """Return in words what a node has."""
    numbers = f"{offer['cores']} cores, {offer['ram_kib'] >> 10} MiB of memory, {offer['disk_kib'] >> 10} MiB of disk"
    return f"{offer['machine']}, {numbers}, Python {offer['python']}, heronry {offer['version']}"
