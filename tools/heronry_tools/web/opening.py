"""Opens and serves what `heronry web` shows: a manager on this computer, buses alone, or a recording.

Of buses alone, it shows only what their frames tell; no manager is asked.
"""

import argparse
import json
import os
import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import manager_socket
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.recording.recorded_folder import head_of
from heronry_tools.sim.scenario.script import read_script
from heronry_tools.sources.opened import opened_source
from heronry_tools.watch.live_feeds import FollowedManager
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.recording import Recording as Recorded
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.app import Site
from heronry_tools.web.following import OpenFeed, read_in_thread
from heronry_tools.web.live import Live
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording
from heronry_tools.web.serving import access, listening, serve
from heronry_wire.frame import LoggedFrame


@dataclass(frozen=True, slots=True)
class Opened:
    """The live state or recording that a page shows, and its source.

    spec, file: the spec, and its file.
    shown: the live state or the recording.
    feed: opens the live feed; None for a recording.
    manager: the socket of the manager that takes orders; None if no manager is watched.
    frames: the frames of a recording; empty for a live system.
    """

    spec: Spec
    file: Path  # of the spec
    shown: Live | Recording
    feed: OpenFeed | None = None
    manager: Path | None = None  # the socket that takes orders
    frames: Sequence[LoggedFrame] = ()


def serve_what(arguments: argparse.Namespace) -> None:
    """Open what the arguments name, and serve it until a signal comes.

    Raises UserError if it cannot be opened or served.
    """
    opened = _opened(arguments)
    if arguments.operate and opened.manager is None:
        raise UserError("--operate: only a manager on this computer takes orders; leave --operate out")
    listener = listening(arguments.listen, arguments.port)
    to = access(listener, operates=arguments.operate)
    questions, orders = Questions(opened.spec, opened.file), Orders(opened.manager)
    site = Site(opened.spec, opened.shown, questions, orders, to, opened.frames)
    if arguments.until_eof:
        threading.Thread(target=_end_with_input, daemon=True).start()

    def begun() -> None:
        address = to.url(with_token=arguments.operate or not to.is_local)
        threading.Thread(target=site.picture, args=("",), daemon=True).start()  # before a browser asks for it
        print(json.dumps({"address": address}) if arguments.json else f"{opened.spec.name}: {address}", flush=True)
        if opened.feed is not None and isinstance(opened.shown, Live):
            read_in_thread(opened.feed, opened.shown, opened.manager, site.change_to)

    serve(site, listener, begun)


def _opened(arguments: argparse.Namespace) -> Opened:
    if arguments.starts_later:
        return _of_a_demo(arguments)

    source = opened_source(arguments)
    if isinstance(source, Recorded):
        shown = Recording(Reducer(source.spec), source.events, source.source)
        return Opened(source.spec, _spec_file(arguments), shown, frames=source.frames)
    live = Live(Reducer(source.spec), source.source)
    if isinstance(source, FollowedManager):
        assert source.spec_file is not None  # a manager names the file of its spec
        return Opened(source.spec, source.spec_file, live, lambda: source, manager_socket(arguments))
    return Opened(source.spec, spec_path(arguments.spec), live, lambda: source)


def _of_a_demo(arguments: argparse.Namespace) -> Opened:
    """Open the manager of a demo, which starts later than its page."""
    spec = load_spec_file(arguments.spec)
    feed = partial(FollowedManager, arguments.socket)
    return Opened(spec, spec_path(arguments.spec), Live(Reducer(spec), "manager"), feed, arguments.socket)


def _spec_file(arguments: argparse.Namespace) -> Path:
    """Return the file of a recording's spec, which the planner's process loads."""
    if arguments.spec is not None:
        return spec_path(arguments.spec)
    if arguments.log.suffix == ".scenario":
        return read_script(arguments.log).spec_file
    folder = Path(arguments.log)
    return folder / str(head_of(folder)["spec_file"])


def _end_with_input() -> None:
    """End this process in an orderly way when its standard input ends."""
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
