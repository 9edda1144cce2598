"""Reads the spec that the argument SPEC of a command names: a file, a shipped spec, `-`, a pipe, or REV:PATH in git."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from heronry_dg.findings import Findings
from heronry_dg.loader import load_bytes, read_file
from heronry_dg.model import Function, Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.yaml_source import MOST_BYTES
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_argument import FLOWN, SHIPPED
from heronry_wire.spelling import meant


@dataclass(frozen=True, slots=True)
class SpecText:
    """The content of SPEC as bytes, and the name that stands for its file in messages."""

    name: str
    data: bytes

    def load(self) -> Spec:
        """Load the spec; raises SpecError."""
        return load_bytes(self.data, self.name)


def load_spec(text: str) -> Spec:
    """Load the spec that SPEC names; raises UserError or SpecError."""
    return spec_text(text).load()


def load_spec_file(text: str) -> Spec:
    """Load the spec that SPEC names; SPEC must be a file, since other processes of this command read the file again.

    Raises UserError or SpecError.
    """
    spec_path(text)
    return load_spec(text)


def spec_text(text: str) -> SpecText:
    """Read the spec that the argument SPEC (`text`) names: a file, a shipped spec, `-`, a pipe, or REV:PATH.

    Raises UserError or SpecError.
    """
    if text == "-":
        return SpecText("<stdin>", sys.stdin.buffer.read(MOST_BYTES + 1))
    if _is_in_git(text):
        return SpecText(text, _from_git(text))
    path = Path(text) if _is_pipe(text) else spec_path(text)
    findings = Findings(str(path))
    data = read_file(path, findings)
    if data is None:
        raise findings.error()
    return SpecText(str(path), data)


def spec_path(text: str) -> Path:
    """Return the path of the spec file that `text` names, for a command that reads the file more than once.

    `text` is the name of a shipped spec, or a path with an ending other than `.table`. Whether the file exists
    is not checked.

    Raises UserError for any other text, such as standard input, a pipe, a version in git or a table.
    """
    if text == "-" or _is_pipe(text) or _is_in_git(text):
        raise UserError(
            f"{text}: this command reads the spec more than once; save it as a *.dg.yaml file, and name that file"
        )
    if text.endswith(".table"):
        raise UserError(f"{text}: a table is what 'heronry table' compiles from a spec; name the *.dg.yaml itself")
    if Path(text).suffix:
        return Path(text)
    if text in SHIPPED or text in FLOWN:
        return shipped_spec_path(text)
    if Path(text).exists():
        raise UserError(f"{text}: the name of a spec's file must end in .dg.yaml; rename this file, or name another")
    remedy = meant(text, (*SHIPPED, *FLOWN), "write a path to a *.dg.yaml")
    raise UserError(f"'{text}' is neither a file nor a shipped spec ({', '.join((*SHIPPED, *FLOWN))}); {remedy}")


def _is_pipe(text: str) -> bool:
    """Tell whether a text names a pipe, as the <(...) of a shell does."""
    return Path(text).is_fifo() or text.startswith("/dev/fd/")


def _is_in_git(text: str) -> bool:
    """Tell whether a text is REV:PATH (an empty REV: what is staged), and no file of this name."""
    return ":" in text and not text.startswith("-") and not Path(text).exists()


def _from_git(text: str) -> bytes:
    """Return the content of a file in a revision; raises UserError."""
    try:
        done = subprocess.run(["git", "cat-file", "blob", text], capture_output=True, check=False)
    except FileNotFoundError:
        raise UserError(
            f"there is no file '{text}', and the form REV:PATH needs git, which is not installed; name a *.dg.yaml"
        ) from None
    if done.returncode == 0:
        return done.stdout
    why = done.stderr.decode(errors="replace").strip().rpartition("\n")[2].removeprefix("fatal: ")
    remedy = "in a folder of the repository, write REV:PATH with PATH from its top, or REV:./PATH from this folder"
    raise UserError(f"{text}: git says: {why}; {remedy}")


def expect_pe(spec: Spec, name: str) -> None:
    """Raise UserError if the spec has no PE of this name."""
    if name not in spec.pes:
        raise UserError(f"no PE is named '{name}'; the spec has {', '.join(spec.pes)}")


def named_function(spec: Spec, name: str) -> Function:
    """Return the function of this name; raises UserError."""
    if name in spec.functions:
        return spec.functions[name]
    raise UserError(f"no function is named '{name}'; {meant(name, spec.functions, there_is='the spec has')}")
