"""Checks that a spec can be simulated: every module needs an image with code, and every device a world to be in.

The plant of the simulator is a script (`aircraft/plant`). A driver of an aircraft with flight dynamics reads nonsense
there, and its monitors report healthy devices. A spec may also have to be one to which another can change in flight.
"""

import sys
from contextlib import suppress
from pathlib import Path

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.sim.world.next_spec import next_spec, why_not

_WITH_DYNAMICS = "heronry_tools.fly."  # code of the aircraft that `heronry fly` flies


def check_images(spec: Spec) -> None:
    """Find the code of each module; raises UserError if a module has none, or drives a device that needs dynamics.

    Code may also be in the current folder, which is therefore added to Python's search path.
    """
    with suppress(FileNotFoundError):  # the present folder may have been removed
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.insert(0, here)
    for module in spec.modules.values():
        try:
            image = find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated ({error})") from None
        if module.device is not None and image.__module__.startswith(_WITH_DYNAMICS):
            raise UserError(
                f"the simulator has no flight dynamics, without which module {module.name} cannot drive device "
                f"{module.device}; fly {spec.name} with 'heronry fly'"
            )


def reload_file(spec: Spec, text: str | None) -> Path | None:
    """Return the file of the spec that `text` names, to which the aircraft is to change in flight; None for None.

    Raises UserError or SpecError if it cannot be read or simulated, or the aircraft cannot change to it.
    """
    if text is None:
        return None
    file = spec_path(text)
    check_images(load_spec_file(text))
    reason = why_not(spec, next_spec(file))
    if reason is not None:
        raise UserError(f"{text}: {reason}")
    return file
