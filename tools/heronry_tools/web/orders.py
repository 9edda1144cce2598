"""Passes the orders of pages on: to the manager on its socket, or to a demo, which kills and restores processes.

The orders to a manager are those of its socket (`control_protocol`), without their version. An order to kill or restore
a process is passed on to the demo, on a socket pair that the demo has made. Examples:

    order to a manager   {"do": "fail", "what": "pe:nav"}
    order to a manager   {"do": "priority", "what": "imaging", "to": 90}
    order to a manager   {"do": "release"}
    order to a manager   {"do": "restore", "what": "pe:nav"}    takes a retired PE back
    order to a demo      {"do": "kill", "what": "nav"}          "start" starts the process again
    answer               {"done": true, "sentence": "..."}
"""

import asyncio
import json
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import ControlError
from heronry_manager.shell.control_protocol import VERSION, Answer, Follow, Spoken, read_order
from heronry_tools.web.following import standby_of

OF_A_MANAGER: Final = ("phase", "fail", "clear", "retire", "restore", "priority", "unlock", "script", "release")
OF_A_DEMO: Final = {"kill": "kill", "start": "restore"}  # the words of the pages, and those of the demo
_PATIENCE_S: Final = 10.0
_LONGEST_ANSWER: Final = 4096


@dataclass(frozen=True, slots=True)
class Orders:
    """Sends orders to the manager's socket and to the demo.

    If one of the two is None, the orders that it would execute are refused.
    """

    manager: Path | None
    demo: socket.socket | None = None

    def kinds(self) -> list[str]:
        """List the kinds of orders that can be given."""
        return [
            *(OF_A_MANAGER if self.manager is not None else ()),
            *(OF_A_DEMO if self.demo is not None else ()),
        ]

    async def give(self, order: object) -> Answer:
        """Send an order; returns the answer, which may be a refusal."""
        match order:
            case {"do": str(do), "what": str(what)} if do in OF_A_DEMO and do in self.kinds():
                return await asyncio.to_thread(self._to_demo, do, what)
            case {"do": str(do), **fields} if do in OF_A_MANAGER and do in self.kinds():
                understood = read_order(json.dumps({**fields, "do": do, "v": VERSION}).encode())
                if not isinstance(understood, str | Follow):
                    return await asyncio.to_thread(self._to_manager, understood)
            case _:
                pass
        known = ", ".join(self.kinds()) or "none"
        return Answer(done=False, sentence=f"this order cannot be given here; possible are {known}")

    def _to_manager(self, order: Spoken) -> Answer:
        assert self.manager is not None
        try:
            return call(self.manager if self.manager.exists() else standby_of(self.manager), order)
        except ControlError as error:
            return Answer(done=False, sentence=str(error))

    def _to_demo(self, do: str, what: str) -> Answer:
        assert self.demo is not None
        self.demo.settimeout(_PATIENCE_S)
        try:
            self.demo.sendall(json.dumps({"do": OF_A_DEMO[do], "what": what.removeprefix("pe:")}).encode() + b"\n")
            answer: dict[str, Any] = json.loads(self.demo.recv(_LONGEST_ANSWER))
        except (OSError, ValueError):
            return Answer(done=False, sentence="the demo does not answer: has it ended?")
        return Answer(done=bool(answer["done"]), sentence=str(answer["sentence"]))
