"""Checks that a spec can be simulated: every module needs an image with code, and every device a world to be in.

The plant of the simulator is a script (`aircraft/plant`). A driver of an aircraft with flight dynamics reads nonsense
there, and its monitors report healthy devices.
"""

import sys
from contextlib import suppress
from pathlib import Path

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError

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
