"""`heronry demo`: the whole system as real processes, with its events as sentences."""

import argparse
from importlib.util import find_spec

from heronry_tools.runtime.demo.play import play


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; returns its exit code, 0 if at the end every function that the plan serves is heard on the bus."""
    for name in ("starlette", "uvicorn") if arguments.web else ():
        if find_spec(name) is None:  # checked now: the process of the page would report it later
            raise ModuleNotFoundError(name=name)
    return play(arguments)
