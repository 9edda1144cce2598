"""Asks the planner's process (`desk`): one question at a time.

A search cannot be interrupted. So if the page no longer waits for the answer of a search, the question is cancelled and
the process is ended. The next question starts another process, which takes a second or two to load the solver. When a
what-if panel is opened, the process is started early.
"""

import asyncio
import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from heronry_dg.model import Spec

_LONGEST_LINE: Final = 16 * 1024 * 1024
_LAST_WORDS: Final = 4_096
NICENESS: Final = 10  # managers and agents on this computer come first


class Questions:
    """Puts questions about one spec to a planner's process, and gives its answers."""

    def __init__(self, spec: Spec, file: Path) -> None:
        self._spec, self._file = spec, file
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()

    async def ask(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer to a question; if the task that awaits it is cancelled, the planner's process is ended.

        If the process ends before it has answered, the answer has the field `refused`, with the reason.
        """
        async with self._turn:
            await self._start()
            process = self._process
            assert process is not None
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                process.stdin.write(json.dumps(question).encode() + b"\n")
                with suppress(ConnectionError):  # reading shows that the process has ended
                    await process.stdin.drain()
                line = await process.stdout.readline()
            except asyncio.CancelledError:
                await self._end()
                raise
            if line.endswith(b"\n"):
                answer: dict[str, Any] = json.loads(line)
                return answer
            return {"refused": f"the planner's process has ended: {await self._last_words()}"}

    def change_to(self, spec: Spec, file: Path) -> None:
        """Ask about another spec from the next question on."""
        self._spec, self._file = spec, file
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()

    async def warm(self) -> None:
        """Start the planner's process, so that the first question need not wait for its start."""
        async with self._turn:
            await self._start()

    async def close(self) -> None:
        """End the planner's process."""
        await self._end()

    async def _start(self) -> None:
        if self._process is not None and self._process.returncode is None:
            return
        self._process = await asyncio.create_subprocess_exec(
            *("nice", "-n", str(NICENESS), sys.executable, "-m", "heronry_tools.web.desk"),
            *(str(self._file), self._spec.digest),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=_LONGEST_LINE,
            process_group=0,
        )

    async def _last_words(self) -> str:
        process = self._process
        assert process is not None
        assert process.stderr is not None
        said = (await process.stderr.read(_LAST_WORDS)).decode(errors="replace").strip()
        await self._end()
        if "No module named 'ortools'" in said:
            return 'ortools is not installed; add it with: pip install "heronry[manager]"'
        return said.rpartition("\n")[2] or "it wrote no message"

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
