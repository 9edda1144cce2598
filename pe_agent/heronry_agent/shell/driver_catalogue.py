"""Which class the `driver` of a device names.

A bare name is a shipped driver (`heronry_agent.drivers`), or an entry point of the group `heronry.drivers` of another
package. `package.module:Class` is imported directly, as the image of a module is.
"""

import importlib
from importlib.metadata import entry_points

from heronry_agent.device_driver import ActuatorDriver, SensorDriver
from heronry_agent.drivers import SHIPPED
from heronry_agent.shell.image_catalogues import is_installed
from heronry_wire.errors import HeronryError
from heronry_wire.spelling import meant

_GROUP = "heronry.drivers"


class UnknownDriverError(HeronryError, LookupError):
    """A driver does not exist or cannot be imported; the message is one sentence."""


def target_of(name: str) -> str:
    """Return the `package.module:Class` that a name of a driver stands for; raises UnknownDriverError.

    Nothing is imported; it is only looked whether the Python module is there.
    """
    target = name
    if ":" not in name:
        offered = {**{one.name: one.value for one in entry_points(group=_GROUP)}, **SHIPPED}
        if name not in offered:
            raise UnknownDriverError(
                f"there is no driver '{name}'; "
                + meant(name, offered, "write package.module:Class for a driver of your own")
            )
        target = offered[name]
    module, _, class_name = target.partition(":")
    if not module or not class_name:
        raise UnknownDriverError(f"driver '{name}' names no class; write package.module:Class")
    if not is_installed(module):
        raise UnknownDriverError(f"driver '{name}': there is no {module} here; install it, or set PYTHONPATH")
    return target


def load_driver(name: str) -> type[SensorDriver] | type[ActuatorDriver]:
    """Return the class of a driver, and import its code; raises UnknownDriverError."""
    module, _, class_name = target_of(name).partition(":")
    try:
        found = getattr(importlib.import_module(module), class_name, None)
    except Exception as error:
        raise UnknownDriverError(
            f"driver '{name}': {module} cannot be imported ({type(error).__name__}: {error}); correct its code, or "
            "install what it needs"
        ) from error
    if isinstance(found, type) and issubclass(found, (SensorDriver, ActuatorDriver)):
        return found
    raise UnknownDriverError(
        f"driver '{name}': {module} has no class {class_name} derived from SensorDriver or ActuatorDriver of "
        "heronry_agent.device_driver"
    )
