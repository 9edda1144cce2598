"""Checks that a spec can be simulated: every module needs an image with code."""

import sys
from contextlib import suppress
from pathlib import Path

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError


def check_images(spec: Spec) -> None:
    """Find the code of each module; raises UserError if a module has none.

    Code may also be in the current folder, which is therefore added to Python's search path.
    """
    with suppress(FileNotFoundError):  # the present folder may have been removed
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.insert(0, here)
    for module in spec.modules.values():
        try:
            find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated ({error})") from None
