"""Can a spec be simulated? Its modules need code."""

from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError


def check_images(spec: Spec) -> None:
    """Refuse a spec with a module whose image has no code; raises UserError."""
    for module in spec.modules.values():
        try:
            find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated: {error}") from None
