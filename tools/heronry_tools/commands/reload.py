"""`heronry reload`: a flying aircraft changes to another spec.

The file is checked and compared here, with the copy that the manager keeps of the spec that flies. The manager reads
the file itself, and refuses it if it is no longer what was shown.

Exit codes: 0 the aircraft flies by the spec; 1 refused or given up: the old spec flies on; 2 the input cannot be used.
"""

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heronry_dg.rules.rule import Severity
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import STANDBY, found_sockets
from heronry_manager.shell.control_protocol import Answer, Reload
from heronry_tools.analysis.diff.difference import difference
from heronry_tools.analysis.diff.findings import findings_change
from heronry_tools.analysis.diff.report import text_report
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import manager_socket, say_answer
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import spec_path, spec_text
from heronry_wire.errors import HeronryError

_LOOK_S, _SAVED_S = 0.2, 0.5


def run(arguments: argparse.Namespace) -> int:
    """Reload once, or at each save; returns the exit code."""
    if arguments.back == (arguments.spec is not None) or (arguments.back and arguments.watch):
        raise UserError("name the spec by which to fly, or give --back alone")
    socket = manager_socket(arguments)
    standby = next((one.stem for one in found_sockets() if one.stem.endswith(STANDBY)), None)
    if standby is not None and not arguments.without_standby:
        raise UserError(
            f"the standby manager {standby} lacks the new spec, and would go back to the old one: stop it and start it "
            "with the new spec afterwards, or give --without-standby"
        )
    if arguments.watch:
        return _watch(arguments, socket, spec_path(arguments.spec))
    if not arguments.back:
        return say_answer(arguments, _reload(arguments, socket, spec_path(arguments.spec)))
    before = _status(socket)["files"].get("before")
    if before is None:
        raise UserError("this manager has flown by no other spec: there is no way back")
    return say_answer(arguments, _reload(arguments, socket, Path(before)))


def _watch(arguments: argparse.Namespace, socket: Path, file: Path) -> int:
    """Reload at each save of a file, until the user ends this; a save that cannot fly is told, and changes nothing."""
    seen = None
    _tell(arguments, f"watching {file}: each save that passes the check flies; end this with Ctrl-C")
    try:
        while True:
            saved = _saved_ns(file)
            if saved is not None and saved != seen:
                seen = saved
                try:
                    say_answer(arguments, _reload(arguments, socket, file))
                except HeronryError as error:
                    print(f"heronry: {error}", file=sys.stderr)
            time.sleep(_SAVED_S)
    except KeyboardInterrupt:
        return 0


def _saved_ns(file: Path) -> int | None:
    """Return when a file was saved last; None: it is not there, as for a moment while an editor saves it."""
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return None


def _reload(arguments: argparse.Namespace, socket: Path, file: Path) -> Answer:
    """Show what changes, ask where the user is to be asked, and wait for the end of the change."""
    status = _status(socket)
    digest, report, errors = _compared(status["files"]["flies"], str(file))
    if digest == status["spec_digest"]:
        return Answer(done=True, sentence=f"the aircraft flies by this spec already ({file})")
    _tell(arguments, report.rstrip())
    if errors:
        return Answer(done=False, sentence=f"{file} does not pass 'heronry check', so it is not flown")
    asks = not (arguments.yes or arguments.back or arguments.watch or arguments.json)
    if asks and not _is_wanted():
        return Answer(done=False, sentence="nothing has changed")
    began = time.monotonic()
    answer = call(socket, Reload(str(file.resolve()), digest))
    return _waited(arguments, socket, digest, began) if answer.done else answer


def _is_wanted() -> bool:
    try:
        return input("fly by this spec? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        print()
        return False


def _compared(old: str, new: str) -> tuple[str, str, bool]:
    """Return the digest of the new spec, what changes, and whether it has errors that the old one has not."""
    with Working(f"comparing {new} with what flies"):
        texts = spec_text(old), spec_text(new)
        specs = texts[0].load(), texts[1].load()
        if specs[0].digest == specs[1].digest:
            return specs[1].digest, "", False
        findings = findings_change(texts[0].name, texts[0].data, texts[1].name, texts[1].data)
        errors = any(finding.severity is Severity.ERROR for finding in findings.new.findings)
        return specs[1].digest, text_report(difference(*specs, findings)), errors


def _waited(arguments: argparse.Namespace, socket: Path, digest: str, began: float) -> Answer:
    """Tell how far the change is until it is over."""
    told = None
    while True:
        status = _status(socket)
        if status["spec_digest"] == digest:
            took = f"{time.monotonic() - began:.1f} s after the order"
            return Answer(done=True, sentence=f"the aircraft flies by {status['spec']} since {took}")
        reload = status["reload"]
        if reload["given_up"] is not None:
            return Answer(done=False, sentence=f"given up, the old spec flies on: {reload['given_up']}")
        if reload["to"] != digest:
            why = "the manager does not carry out this order any more: see 'heronry status', and give it again"
            return Answer(done=False, sentence=why)
        if reload["state"] != told:
            told = reload["state"]
            _tell(arguments, told)
        time.sleep(_LOOK_S)


def _tell(arguments: argparse.Namespace, text: str) -> None:
    if not arguments.json:
        print(text, flush=True)


def _status(socket: Path) -> Mapping[str, Any]:
    status = call(socket, AskStatus()).status
    if status is None or "flies" not in status["files"]:
        raise UserError("this manager cannot fly by another spec: start it again with this version of heronry")
    return status
