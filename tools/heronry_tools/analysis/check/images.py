"""The check of DG6xx: the code of a spec's modules is searched for on this computer, and loaded if it is here.

An image `package.module:Class` is imported if its package is here; if not, DG602 says so. A bare name must be in an
installed catalogue (DG602; with a full stop in it, DG603). An image that is not written, and so has the module's name,
is expected here only if a catalogue has some other image of the spec.

A package is searched for in the folder of the spec, in the present folder, and where Python finds packages. Code may do
anything when it is imported, so a process of its own imports it:

    python -m heronry_tools.analysis.check.images FOLDER IMAGE ...

The process prints one line of JSON for each image: the image, and the reason why it cannot be loaded, or null. If the
process ends or hangs, the first image without a line gets the finding, and the images after it get none.
"""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Final

from heronry_agent.shell.image_catalogues import why_not_here
from heronry_agent.shell.module_runner import ModuleRunner
from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_tools.analysis.check.image_rules import IMAGE_NOT_HERE, IMAGE_NOT_LOADED, WITHOUT_COLON

LIMIT_S: Final = 20.0  # an agent waits as long for its code to be loaded


def check(subject: Subject, findings: Findings) -> None:
    """Search for the images of a spec, and load each image `package.module:Class` whose package is on this computer.

    Add a finding for each module whose image cannot be loaded, or is not here.
    """
    _absent(subject, findings)
    folder = Path(subject.file).resolve().parent
    images = {module.image for module in subject.spec.modules.values() if ":" in module.image}
    found = sorted(image for image in images if _is_here(image, folder))
    problems = _problems(folder, found) if found else {}
    for module in subject.spec.modules.values():
        problem = problems.get(module.image)
        if problem is not None:
            findings.add(
                IMAGE_NOT_LOADED,
                subject.place("modules", module.name, "image"),
                f"module '{module.name}' cannot run: {problem}",
                f"see: heronry module try {module.image}",
            )


def _absent(subject: Subject, findings: Findings) -> None:
    """Report the images that no catalogue has and no import finds."""
    folder = Path(subject.file).resolve().parent
    modules = subject.spec.modules.values()
    reasons = {image: _why_absent(image, folder) for image in dict.fromkeys(module.image for module in modules)}
    flown_here = any(reason is None and ":" not in image for image, reason in reasons.items())
    for module in modules:
        reason = reasons[module.image]
        is_written = module.image != module.name
        if reason is None or not (is_written or flown_here):
            continue
        meant = _with_colon(module.image, folder)
        place = subject.place("modules", module.name, "image")
        sentence = f"module '{module.name}' has no code on this computer: {reason}"
        if meant is not None:
            sentence = f"image '{module.image}' of module '{module.name}' has no colon before its class"
            findings.add(WITHOUT_COLON, place, sentence, f"write {meant}")
        else:
            findings.add(IMAGE_NOT_HERE, place, sentence, "install the code, or correct the name")


def _why_absent(image: str, folder: Path) -> str | None:
    """Say why the code of an image is not on this computer; None if it is."""
    if ":" not in image:
        return why_not_here(image)
    package = image.partition(":")[0].partition(".")[0]
    return None if _is_here(image, folder) else f"image '{image}': there is no {package} here"


def _with_colon(image: str, folder: Path) -> str | None:
    """Return `package.module:Class` for `package.module.Class`, if the package is here or the class has a capital."""
    module, _, name = image.rpartition(".")
    if ":" in image or not module or not (name[:1].isupper() or _is_here(image, folder)):
        return None
    return f"{module}:{name}"


def _is_here(image: str, folder: Path) -> bool:
    """Tell whether the package of an image is found; this runs no code of the package."""
    package = image.partition(":")[0].partition(".")[0]
    return PathFinder.find_spec(package, [str(folder), str(Path.cwd()), *sys.path]) is not None


def _problems(folder: Path, images: Sequence[str]) -> Mapping[str, str | None]:
    """Load images one by one in a separate process, and return for each the reason why it cannot be loaded.

    None as the reason: the image can be loaded. An image that ends or hangs the process gets that as its reason,
    and the images after it are missing from the result.
    """
    command = [sys.executable, "-m", __name__, str(folder), *images]
    try:
        ran = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=LIMIT_S, check=False)
        said, end = ran.stdout, f"it ends the process (exit code {ran.returncode})"
    except subprocess.TimeoutExpired as hung:
        said, end = hung.stdout or b"", f"it has not been loaded after {LIMIT_S:g} s"
    problems: dict[str, str | None] = dict(map(json.loads, said.splitlines()))
    guilty = next((image for image in images if image not in problems), None)
    return problems if guilty is None else {**problems, guilty: f"image '{guilty}': {end}"}


def main(folder: str, images: Sequence[str]) -> None:
    """Load images one by one, and print a line about each."""
    sys.path[:0] = [folder, str(Path.cwd())]
    runner, out = ModuleRunner(lambda: 0), sys.stdout
    for image in images:
        with redirect_stdout(sys.stderr):
            failure = runner.load(image)
        print(json.dumps([image, None if failure is None else failure.reason]), file=out, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
