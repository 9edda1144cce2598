"""Where the output of a command goes, and in which form: --json, --format and -o FILE, the same in every command.

*Form.* Text is for people, JSON for programs. If a command has further forms, --format selects one. If no option
selects the form, the ending of FILE does: a plan in `plan.json` is JSON. If FILE has the ending of another form than
the selected one, it is refused. So a picture named .png never holds SVG.

*Place.* With -o the output goes to FILE, and is not printed. A file is written when the command has ended, as a whole
or not at all (`whole_file`). A device or a pipe is written directly.
"""

import argparse
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from functools import partial
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Final

from heronry_tools.console.errors import UserError
from heronry_tools.console.whole_file import expect_writable, write_whole

Forms = Mapping[str, tuple[str, ...]]
"""Names of forms, the usual one first, and the endings of their files."""

JSON: Final = (".json",)
TEXT_OR_JSON: Final[Forms] = {"text": (), "json": JSON}
_SPECS: Final = (".yaml", ".yml")  # endings of specs: people write these files, so no command may overwrite one
_NAMED: Final[Mapping[str, str]] = {  # by ending: the form that a person or a program expects in such a file
    ".json": "JSON",
    **dict.fromkeys((".mmd", ".mermaid"), "Mermaid"),
    **dict.fromkeys((".dot", ".gv"), "graph for Graphviz"),
    **dict.fromkeys((".html", ".htm"), "HTML"),
    ".svg": "SVG",
    ".xml": "XML",
    ".md": "Markdown",
    ".sarif": "SARIF",
    ".dbc": "DBC",
    ".eds": "EDS",
    ".table": "table of a PE",
}
_PICTURES: Final = (".png", ".pdf", ".jpg", ".jpeg", ".gif", ".webp", ".bmp", ".tif", ".tiff", ".ps", ".eps")


def add_output_file(parser: argparse.ArgumentParser, form: str, ending: str) -> None:
    """Add -o FILE to a command that has one form of output, whose files have this ending."""
    _add_file(parser)
    parser.set_defaults(only_form={form: (ending,)})


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        dest="report_file",
        metavar="FILE",
        type=Path,
        help="write to this file instead of standard output",
    )


def add_json(parser: argparse.ArgumentParser, what: str = "write the answer as JSON") -> None:
    """Add --json to a command that has no -o."""
    parser.add_argument("--json", action="store_true", help=what)


def add_output(
    parser: argparse.ArgumentParser,
    what: str = "write the result as JSON",
    forms: Forms = TEXT_OR_JSON,
    usual: str | None = None,
) -> None:
    """Add -o FILE and --json; add --format, too, if there are more forms than text and JSON.

    what: the help of --json.
    forms: the forms of the output, the usual one first, with the endings of their files.
    usual: what the help says about the default form, if the command itself chooses this form. None: the default is the
        first form.
    """
    _add_file(parser)
    choice = parser.add_mutually_exclusive_group()
    if len(forms) > len(TEXT_OR_JSON):
        default = usual or next(iter(forms))
        choice.add_argument(
            "--format",
            choices=tuple(forms),
            help=f"form of the output (default: the form that the ending of FILE names, otherwise {default})",
        )
    if "json" in forms:
        choice.add_argument("--json", dest="format", action="store_const", const="json", help=what)
    parser.set_defaults(forms=forms, has_usual_form=usual is None)


def settled(arguments: argparse.Namespace) -> argparse.Namespace:
    """Choose the form of the output by the options and the ending of FILE; returns the arguments.

    If the command has a choice of forms, `format` and `json` of the arguments are set; `format` is None if the
    command itself chooses its usual form.

    Raises UserError if the ending of FILE is that of a spec, or of a form that the command does not have. Also
    raises it if an option selects one form and the ending is that of another form.
    """
    forms: Forms | None = getattr(arguments, "forms", None)
    file: Path | None = getattr(arguments, "report_file", None)
    if forms is None:
        if file is not None:
            expect_ending(file, getattr(arguments, "only_form", {}))
        return arguments
    named = None if file is None else _form_of(file, forms)
    form = getattr(arguments, "format", None)
    if file is not None and form is not None and named is not None and file.suffix.lower() not in forms[form]:
        raise UserError(f"{file} would be written as {form}, but its ending is that of {named}; name another file")
    usual = next(iter(forms)) if arguments.has_usual_form else None
    arguments.format = form or named or usual
    arguments.json = arguments.format == "json"
    return arguments


def _form_of(file: Path, forms: Forms) -> str | None:
    """Return the form in `forms` to which the ending of a file belongs; None if it belongs to none of them.

    Raises UserError if the ending is that of a spec, or of a known form that is not in `forms`.
    """
    expect_ending(file, forms)
    ending = file.suffix.lower()
    return next((form for form, endings in forms.items() if ending in endings), None)


def expect_ending(file: Path, forms: Forms) -> None:
    """Raise UserError if the ending of a file is that of a spec, or of a form that is not one of `forms`."""
    ending = file.suffix.lower()
    if ending in _SPECS:
        raise UserError(f"{file}: a file with this ending is a spec, and no command writes specs; name another file")
    known = list(dict.fromkeys(one for endings in forms.values() for one in endings))
    if ending in known or ending not in (*_PICTURES, *_NAMED):
        return
    what = _NAMED.get(ending, ending[1:].upper())
    drawn = file.with_suffix(".svg")
    if ending in _PICTURES and "svg" in forms:
        remedy = f"convert an SVG: -o {drawn}, then rsvg-convert -f {ending[1:]} -o {file} {drawn}"
    else:
        remedy = f"what it writes ends in {', '.join([*known, '.txt'] if 'text' in forms else known)}"
    raise UserError(f"{file}: this command writes no {what}; {remedy}")


def run_into_its_file(run: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Run a command, and put what it prints into the file of -o; returns its exit code.

    Codes 0 and 1 are answers. With any other code, or an exception, nothing is written, and FILE stays as it was.
    """
    file: Path | None = getattr(arguments, "report_file", None)
    if file is None or str(file) == "-":
        return run(arguments)
    is_stream = file.exists() and not file.is_file() and not file.is_dir()
    if not is_stream:
        expect_writable(file)
    text = TextIOWrapper(BytesIO(), encoding="utf-8", newline="", write_through=True)
    with redirect_stdout(text):
        code = run(arguments)
    if code <= 1:
        text.seek(0)
        (file.write_bytes if is_stream else partial(write_whole, file))(text.buffer.read())
    return code
