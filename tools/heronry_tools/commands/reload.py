"""`heronry reload`: a flying aircraft changes to another spec.

The file is checked and compared here, with the copy that the manager keeps of the spec that flies. The manager reads
the file itself, and refuses it if it is no longer what was shown. A standby manager on this computer is given the file
first; where it does not take the file, nothing is ordered.

Exit codes: 0 the aircraft flies by the spec; 1 refused or given up: the old spec flies on; 2 the input cannot be used.
"""

import argparse
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heronry_dg.rules.rule import Severity
from heronry_manager.core.mastership import Mastership
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_client import call, find_socket, is_listened_on, running_sockets
from heronry_manager.shell.control_place import active_of, standby_of
from heronry_manager.shell.control_protocol import Answer, Reload
from heronry_tools.analysis.diff.difference import difference
from heronry_tools.analysis.diff.findings import findings_change
from heronry_tools.analysis.diff.report import text_report
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import say_answer
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import spec_path, spec_text
from heronry_wire.element_places import spec_mark
from heronry_wire.errors import HeronryError

_LOOK_S, _SAVED_S = 0.2, 0.5
_FOLLOWS_S = 5.0  # in which a standby manager hears of the change


@dataclass(frozen=True, slots=True)
class Managers:
    """The sockets of the managers here: of the active one and of the standby manager; None: it does not run here."""

    active: Path | None
    standby: Path | None


def run(arguments: argparse.Namespace) -> int:
    """Reload once, or at each save; returns the exit code."""
    if arguments.back == (arguments.spec is not None) or (arguments.back and arguments.watch):
        raise UserError("name the spec by which to fly, or give --back alone")
    if arguments.standby and (arguments.watch or arguments.without_standby):
        raise UserError("--standby gives the spec to the standby manager alone: leave the other option out")
    managers = _managers(arguments)
    socket = managers.standby if arguments.standby else managers.active
    if socket is None and arguments.standby:
        raise UserError("no standby manager runs here: give --standby on the computer of the standby manager")
    if socket is None:
        raise UserError(
            "the manager here stands by: give it the spec with --standby, and then order the change on the computer of "
            "the active manager"
        )
    if arguments.watch:
        return _watch(arguments, managers, spec_path(arguments.spec))
    file = _before(socket) if arguments.back else spec_path(arguments.spec)
    return say_answer(
        arguments, _stage(arguments, socket, file) if arguments.standby else _reload(arguments, managers, file)
    )


def _managers(arguments: argparse.Namespace) -> Managers:
    """Find the managers of the spec that is named, or of the only one that is flown from here."""
    named = arguments.socket or (None if arguments.of is None else find_socket(arguments.of))
    here = {active_of(path) for path in running_sockets()} if named is None else {active_of(named)}
    first = here.pop() if len(here) == 1 else find_socket(None)
    roles: dict[bool, Path] = {}
    for path in (first, standby_of(first)):
        if path == named or is_listened_on(path):
            roles[_status(path)["manager"]["state"] == Mastership.STANDBY.value] = path
    return Managers(roles.get(False), roles.get(True))


def _before(socket: Path) -> Path:
    before = _status(socket)["files"].get("before")
    if before is None:
        raise UserError("this manager has flown by no other spec: there is no way back")
    return Path(before)


def _watch(arguments: argparse.Namespace, managers: Managers, file: Path) -> int:
    """Reload at each save of a file, until the user ends this; a save that cannot fly is told, and changes nothing."""
    seen = None
    _tell(arguments, f"watching {file}: each save that passes the check flies; end this with Ctrl-C")
    try:
        while True:
            saved = _saved_ns(file)
            if saved is not None and saved != seen:
                seen = saved
                try:
                    say_answer(arguments, _reload(arguments, managers, file))
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


def _stage(arguments: argparse.Namespace, standby: Path, file: Path) -> Answer:
    """Give a file to the standby manager; if that spec flies already, wait until the manager follows."""
    status = _status(standby)
    digest, report, errors = _compared(status["files"]["flies"], str(file))
    if digest == status["spec_digest"]:
        return Answer(done=True, sentence=f"the standby manager has this spec already ({file})")
    _tell(arguments, report.rstrip())
    if errors:
        return Answer(done=False, sentence=f"{file} does not pass 'heronry check', so it is given to nobody")
    answer = call(standby, Reload(str(file.resolve()), digest, for_standby=True))
    if not answer.done or status["reload"]["flies"] != f"{spec_mark(digest):04x}":
        return answer
    return Answer(done=True, sentence=f"{answer.sentence}{_followed(standby, digest)}")


def _reload(arguments: argparse.Namespace, managers: Managers, file: Path) -> Answer:
    """Show what changes, ask where the user is to be asked, and wait for the end of the change."""
    assert managers.active is not None
    status = _status(managers.active)
    digest, report, errors = _compared(status["files"]["flies"], str(file))
    if digest == status["spec_digest"]:
        return Answer(done=True, sentence=f"the aircraft flies by this spec already ({file})")
    _tell(arguments, report.rstrip())
    if errors:
        return Answer(done=False, sentence=f"{file} does not pass 'heronry check', so it is not flown")
    asks = not (arguments.yes or arguments.back or arguments.watch or arguments.json)
    if asks and not _is_wanted():
        return Answer(done=False, sentence="nothing has changed")
    order = Reload(str(file.resolve()), digest)
    refused = None if managers.standby is None else _given(managers.standby, order)
    if refused is not None and not arguments.without_standby:
        says = f"the standby manager does not take the spec: {refused}; mend that, or give --without-standby"
        return Answer(done=False, sentence=says)
    began = time.monotonic()
    answer = call(managers.active, order)
    if answer.done:
        answer = _waited(arguments, managers.active, digest, began)
    if answer.done and managers.standby is not None and refused is None:
        return Answer(done=True, sentence=f"{answer.sentence}{_followed(managers.standby, digest)}")
    return answer


def _given(standby: Path, order: Reload) -> str | None:
    """Give the spec of an order to the standby manager; returns why it does not take it, None: it has the spec."""
    if _status(standby)["spec_digest"] == order.digest:
        return None
    answer = call(standby, Reload(order.file, order.digest, for_standby=True))
    return None if answer.done else answer.sentence


def _followed(standby: Path, digest: str) -> str:
    """Wait until the standby manager has followed; returns what to say of it."""
    until = time.monotonic() + _FOLLOWS_S
    while time.monotonic() < until:
        if _status(standby)["spec_digest"] == digest:
            return ", and the standby manager has followed"
        time.sleep(_LOOK_S)
    return "; the standby manager has not followed yet: see its 'heronry status'"


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
