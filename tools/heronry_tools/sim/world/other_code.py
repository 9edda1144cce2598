"""Another version of the code of an image, as one PE may have it after an update that has not reached the others.

The other version computes the same; only its name differs. So it has another digest
(`heronry_agent.shell.code_digest`), as code whose file was changed. A simulated PE starts it by its own name, which
`other_version` gives.
"""

from heronry_agent.module import Module
from heronry_agent.shell.image_catalogues import find_image

_OTHER = " (other version)"
_OTHERS: dict[type[Module], type[Module]] = {}


def other_version(image: str) -> str:
    """Return the name of the other version of an image."""
    return image + _OTHER


def find_version(image: str) -> type[Module]:
    """Return the class of an image, or of its other version; raises as `find_image` if there is none."""
    present = image.removesuffix(_OTHER)
    code = find_image(present)
    return code if present == image else _other(code)


def version_of(code: Module) -> str:
    """Return the name of the version of a module's code: equal names are equal code, whatever a PE says of it."""
    return f"{type(code).__module__}:{type(code).__qualname__}"


def _other(code: type[Module]) -> type[Module]:
    if code not in _OTHERS:
        names = {"__module__": code.__module__, "__qualname__": code.__qualname__ + _OTHER}
        _OTHERS[code] = type(code.__name__, (code,), names)
    return _OTHERS[code]
