"""`python -m lab.fuzz`: give every decoder, and every core, arbitrary bytes.

With `--count` the inputs are drawn from a seed, without guidance, and the same ones each time: that is what the tests
do. With `--seconds` atheris looks for inputs that reach new code, where it is installed (`pip install
'heronry[fuzz]'`); where it is not, unguided inputs follow one another for that time.

An input that makes its target raise is a finding: it is written to a file, and the command that repeats it is printed.
"""

import argparse
import importlib.util
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from hashlib import sha256
from itertools import islice
from pathlib import Path
from random import Random

from heronry_tools.console.errors import UserError, exit_code
from heronry_tools.console.progress import Progress
from heronry_wire.errors import HeronryError
from lab.fuzz.mutation import inputs
from lab.fuzz.target import Target
from lab.fuzz.targets import TARGETS

_COUNT = 300
_LOOK_EVERY = 64
_EPILOG = """\
examples:
  python -m lab.fuzz                         some hundred inputs for each target
  python -m lab.fuzz --seconds 20            20 s altogether; guided, where atheris is installed
  python -m lab.fuzz table --count 100000    one target
  python -m lab.fuzz table --input FILE      repeat a finding, with its traceback
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Fuzz; returns 1 with a finding, 2 where the command line is wrong."""
    arguments = _parser().parse_args(argv)
    if arguments.count < 1 or (arguments.seconds is not None and arguments.seconds < 1):
        print("heronry: --count and --seconds are 1 or more", file=sys.stderr)
        return 2
    unknown = [name for name in arguments.targets if name not in TARGETS]
    if unknown:
        print(f"heronry: there is no target '{unknown[0]}'; the targets are {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    targets = [TARGETS[name] for name in arguments.targets] or [*TARGETS.values()]
    if arguments.input is not None:
        return _repeat(targets, arguments.input)
    try:
        return 1 if sum([_fuzz(target, arguments, len(targets)) for target in targets]) else 0
    except HeronryError as error:
        print(f"heronry: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m lab.fuzz",
        description="Give every decoder, and every core, arbitrary bytes.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"default: all of {', '.join(TARGETS)}")
    how_long = parser.add_mutually_exclusive_group()
    how_long.add_argument("--count", type=int, default=_COUNT, metavar="N", help=f"inputs for each (default {_COUNT})")
    how_long.add_argument(
        "--seconds", type=int, metavar="S", help="how long altogether, without the start of each target"
    )
    how_long.add_argument("--input", type=Path, metavar="FILE", help="give the target this input alone")
    parser.add_argument("--seed", type=int, default=0, metavar="NUMBER", help="the same seed draws the same inputs")
    parser.add_argument(
        "--corpus",
        type=Path,
        default=Path("tests/fuzz_corpus"),
        metavar="DIR",
        help="more inputs to begin from, in a folder for each target (default: tests/fuzz_corpus, where it exists)",
    )
    return parser


def corpus(folder: Path, target: Target) -> list[bytes]:
    """Return the first inputs of a target: its seeds, and the files that are kept for it."""
    return [*target.seeds(), *(file.read_bytes() for file in sorted((folder / target.name).glob("*")))]


def _fuzz(target: Target, arguments: argparse.Namespace, share: int) -> int:
    """Fuzz one target; gives the number of findings."""
    seconds = None if arguments.seconds is None else max(1, arguments.seconds // share)
    if seconds is not None and importlib.util.find_spec("atheris") is not None:
        return _guided(target, corpus(arguments.corpus, target), seconds)
    drawn = inputs(corpus(arguments.corpus, target), Random(f"{arguments.seed} {target.name}"))
    begun_s, done = time.process_time(), 0
    with Progress() as progress:
        progress.begin(target.name, arguments.count)
        for data in islice(drawn, arguments.count) if seconds is None else _for_seconds(drawn, seconds):
            try:
                target.run(data)
            except Exception as error:  # noqa: BLE001 - any exception is a finding
                return _found(target, data, error)
            done += 1
            progress.step()
    print(f"{target.name}: {done} inputs in {time.process_time() - begun_s:.1f} s of CPU, nothing found")
    return 0


def _for_seconds(drawn: Iterator[bytes], seconds: int) -> Iterator[bytes]:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        yield from islice(drawn, _LOOK_EVERY)


def _guided(target: Target, begin: Sequence[bytes], seconds: int) -> int:
    """Fuzz with atheris, in a process of its own, since libFuzzer does not return."""
    with tempfile.TemporaryDirectory(prefix="heronry-fuzz-") as folder:
        for number, data in enumerate(begin):
            (Path(folder) / f"kept-{number}").write_bytes(data)
        command = [sys.executable, "-m", "lab.fuzz.guided", target.name, str(seconds), folder]
        ran = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        for crash in sorted(Path(folder).glob("crash-*")):
            return _found(target, crash.read_bytes(), None)
        if ran.returncode:
            raise UserError(f"atheris has ended with exit code {ran.returncode}: {ran.stderr.strip()[-300:]}")
        reached = len(list(Path(folder).iterdir())) - len(begin)
    print(f"{target.name}: {seconds} s guided by code coverage, {reached} inputs that reach new code, nothing found")
    return 0


def _found(target: Target, data: bytes, error: Exception | None) -> int:
    file = Path(f"fuzz-{target.name}-{sha256(data).hexdigest()[:12]}")
    file.write_bytes(data)
    what = "" if error is None else f": {type(error).__name__}: {error}"
    print(f"{target.name}: FOUND{what[:300]}")
    print(f"  repeat it with: python -m lab.fuzz {target.name} --input {file}")
    return 1


def _repeat(targets: Sequence[Target], file: Path) -> int:
    data = file.read_bytes()
    for target in targets:
        try:
            target.run(data)
        except Exception:  # noqa: BLE001 - the finding, to be shown
            traceback.print_exc()
            return 1
    print("the target raises nothing")
    return 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "fuzz"))
