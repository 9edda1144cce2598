"""DG6xx, rules about images: the code of a spec's modules can be loaded, if it is found on this computer.

images.py checks these rules in a spec that loads. The check imports code that is not part of heronry. So `check
--fast`, which a hook runs at every commit, leaves it out. The head of heronry_dg/rules/rule.py shows how a rule is
added.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DRIVER, RUNS

FAMILY: Final = Family("DG6", "images: code that is found here", fast=False)


def _lamp(image: str) -> str:
    return f"modules:\n{DRIVER}  display: {{device: lamp, needs: speed, image: '{image}', {RUNS}}}\n"


IMAGE_NOT_LOADED = FAMILY.warning(
    "DG601",
    "image-not-loaded",
    what="An image `package.module:Class` is found on this computer, and cannot be loaded.",
    why=(
        "On a PE it would fail in the same way, when the PE loads its code. An image whose package is not on this "
        "computer gets DG602 instead."
    ),
    fix="Mend the code, or the name; `heronry module try IMAGE` shows the traceback.",
    bad=_lamp("heronry_agent.module:Modul"),
    good=_lamp("heronry_agent.module:Module"),
)
IMAGE_NOT_HERE = FAMILY.warning(
    "DG602",
    "image-not-here",
    what="No catalogue has an image of the spec, and no import finds it.",
    why=(
        "A PE without the code of a module cannot run it. The code of a node need not be on this computer, so this is "
        "a warning. A module without `image` is checked only if a catalogue here has another image of the spec."
    ),
    fix="Install the code, or correct the name: a name in a catalogue, or `package.module:Class`.",
    bad=_lamp("no_such_package:Lamp"),
    good=_lamp("heronry_agent.module:Module"),
)
WITHOUT_COLON = FAMILY.warning(
    "DG603",
    "image-without-colon",
    what="An image is written `package.Class`; before the class there must be a colon.",
    why="Without a colon it is a name to be looked up in the catalogues, and no catalogue has it.",
    fix="Write `package.module:Class`.",
    bad=_lamp("heronry_agent.module.Module"),
    good=_lamp("heronry_agent.module:Module"),
)
