"""One target under atheris, which keeps every input that reaches new code: started by `lab.fuzz`.

    python -m lab.fuzz.guided TARGET SECONDS FOLDER

libFuzzer takes over the process, reads and extends the inputs in FOLDER, and leaves a file `crash-*` there when the
target raises. Instrumenting takes some seconds before the first input.
"""

import sys
from pathlib import Path

import atheris

_INSTRUMENTED = ["heronry_wire", "heronry_agent", "heronry_dg", "heronry_manager"]
_LONGEST_BYTES = 4_096


def main() -> None:
    """Fuzz until the time is up or there is a finding; the exit code is libFuzzer's."""
    name, seconds, folder = sys.argv[1:]
    with atheris.instrument_imports(include=_INSTRUMENTED, enable_loader_override=False):
        from lab.fuzz.targets import TARGETS  # noqa: PLC0415 - its imports have to be instrumented

    target = TARGETS[name]
    for number, seed in enumerate(target.seeds()):
        (Path(folder) / f"seed-{number}").write_bytes(seed)
    arguments = [f"-max_total_time={seconds}", f"-max_len={_LONGEST_BYTES}", f"-artifact_prefix={folder}/", folder]
    atheris.Setup([sys.argv[0], *arguments], target.run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
