"""Checks that a spec can be simulated: every module needs an image with code."""

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError


def check_images(spec: Spec) -> None:
    """Raise UserError if the image of a module has no code."""
    for module in spec.modules.values():
        try:
            find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated: {error}") from None
