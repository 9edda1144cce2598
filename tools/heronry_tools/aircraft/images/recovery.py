"""The two events that end a flight: the logic of the parachute, and that of the balloon's line.

The logic of the parachute has two inputs, the release command and the altitude (section 3.1 of the paper by Rawashdeh
et al.). While a command not to release comes, the parachute stays shut at any altitude. While no command comes, an
altitude above the opening altitude is enough to keep it shut. The parachute opens in one of three cases:

- the command to release is given;
- the command has been missing for 3 s, and the aircraft, which has been above 3 000 m, is now below the opening
  altitude. The logic waits no longer for a command, since below this altitude a command would come too late;
- *by default*: both inputs have been missing for 3 s. This is longer than a reconfiguration takes, and longer than the
  inputs need to come after a start.

The balloon's line is cut in one of three cases:

- the command to cut it is given;
- the aircraft has been at the planned altitude or higher for 1 s, and the wings are ready or their state is unknown;
- the aircraft has been for 1 s at the altitude at which the balloon bursts by itself, or higher. Then the state of the
  wings does not matter.

Neither module withdraws its output. A restart loses the output; the module gives the output again if one of the cases
still holds. A restart of the parachute's logic also loses whether the aircraft has been high. After a restart below the
opening altitude, only a command or the default can open the parachute.
"""

from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number, whole
from heronry_tools.aircraft.images.wing import WingState

_NEITHER_HEARD_NS = 3_000_000_000
_NO_COMMAND_NS = 3_000_000_000
_HAS_BEEN_HIGH_M = 3_000.0
_OPENING_M = 800.0
_CUT_M = 19_800.0
_CUT_HOLD_NS = 1_000_000_000
_BURST_M = 24_000.0


class ChuteLogic(Module):
    """Decides when the parachute opens: `chute_release` is 1 to open it."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._released = False
        self._has_been_high = False
        self._no_command_ns = 0
        self._neither_ns = 0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish `chute_release`: 1 from the moment at which the parachute must open, 0 before."""
        command, altitude_m = whole(inputs, "release_command"), number(inputs, "altitude")
        period_ns = self.ctx.period_ns
        self._no_command_ns = self._no_command_ns + period_ns if command is None else 0
        self._neither_ns = self._neither_ns + period_ns if command is None and altitude_m is None else 0
        if altitude_m is not None and altitude_m > _HAS_BEEN_HIGH_M:
            self._has_been_high = True
        self._released = self._released or self._should_open(command, altitude_m)
        return {"chute_release": int(self._released)}

    def _should_open(self, command: int | None, altitude_m: float | None) -> bool:
        if command is not None:
            return command != 0
        if altitude_m is None:
            return self._neither_ns >= _NEITHER_HEARD_NS
        return self._no_command_ns >= _NO_COMMAND_NS and self._has_been_high and altitude_m < _OPENING_M


class CutdownLogic(Module):
    """Decides when the balloon's line is cut: `balloon_cut` is 1 to cut it."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._cut = False
        self._high_ns = 0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish `balloon_cut`: 1 from the moment at which the line must be cut, 0 before."""
        command, altitude_m = whole(inputs, "cutdown_command"), number(inputs, "altitude")
        reached = altitude_m is not None and altitude_m >= _cut_altitude_m(whole(inputs, "wing_state"))
        self._high_ns = self._high_ns + self.ctx.period_ns if reached else 0
        self._cut = self._cut or bool(command) or self._high_ns >= _CUT_HOLD_NS
        return {"balloon_cut": int(self._cut)}


def _cut_altitude_m(wing_state: int | None) -> float:
    ready = wing_state is None or wing_state in {WingState.FIRM, WingState.CURED}
    return _CUT_M if ready else _BURST_M
