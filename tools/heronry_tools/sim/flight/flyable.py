"""Checks that a spec can be simulated: every module needs an image with code."""

import sys
from contextlib import suppress
from pathlib import Path

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError


def check_images(spec: Spec) -> None:
    """Look for the code of each module, also in the present folder; raise UserError where there is none."""
    with suppress(FileNotFoundError):  # the present folder may have been removed
        here = str(Path.cwd())
        if here not in sys.path:
            sys.path.insert(0, here)
    for module in spec.modules.values():
        try:
            find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated: {error}") from None
