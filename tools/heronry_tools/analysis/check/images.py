"""The check of DG6xx: images of the form `package.module:Class` are imported if their package is on this computer.

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

from heronry_agent.shell.module_runner import ModuleRunner
from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_tools.analysis.check.image_rules import IMAGE_NOT_LOADED

LIMIT_S: Final = 20.0  # an agent waits as long for its code to be loaded


def check(subject: Subject, findings: Findings) -> None:
    """Load every image `package.module:Class` of a spec whose package is on this computer.

    Add a finding for each module whose image cannot be loaded. An image whose package is not on this computer
    gets no finding.
    """
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
