"""Control surfaces and their servos: rate limit, stops, and the ways in which a servo fails.

Two servos can drive one surface. The servo that was commanded last holds the surface. When this servo is dead or stuck,
the surface stays where it is until the other servo is commanded. A loose servo accepts commands, but the air stream
moves the surface back to neutral. A servo with a bias moves the surface to the command plus a constant.
"""

from dataclasses import dataclass, field

_FLOATS_BACK_S = 0.3


@dataclass(slots=True)
class Surface:
    """One control surface, or the throttle: its position follows its target at a limited rate.

    Position, target and stops are in degrees; those of the throttle are 0 to 1.
    """

    least: float
    most: float
    rate_per_s: float
    position: float = 0.0
    target: float = 0.0
    is_loose: bool = False

    def push(self, target: float) -> float:
        """Limit a new target to the stops, set it, and return it."""
        self.target = min(max(target, self.least), self.most)
        return self.target

    def step(self, dt_s: float) -> float:
        """Move for `dt_s`, and return the new position in degrees; of the throttle, 0 to 1."""
        if self.is_loose:
            self.position -= self.position * min(dt_s / _FLOATS_BACK_S, 1.0)
            return self.position
        most = self.rate_per_s * dt_s
        self.position += min(max(self.target - self.position, -most), most)
        return self.position


@dataclass(slots=True)
class Servos:
    """All servos of an aircraft: which surface each servo drives, and which servos have failed."""

    surfaces: dict[str, Surface]
    pushes: dict[str, str]  # by servo: its surface
    failed: dict[str, tuple[str, float]] = field(default_factory=dict)  # by servo: how, and by how much
    last: dict[str, str] = field(default_factory=dict)  # by surface: the servo that was driven last
    accepted: dict[str, float] = field(default_factory=dict)  # by servo: the last command that it accepted

    def read(self, servo: str) -> float | None:
        """Return the last command that a servo has accepted; None before the first one, and from a dead servo."""
        return None if self.failed.get(servo, ("", 0.0))[0] == "dead" else self.accepted.get(servo)

    def command(self, servo: str, value: float) -> float | None:
        """Command a servo, and return the command that the servo accepted; None if the servo is dead or stuck."""
        how, offset = self.failed.get(servo, ("", 0.0))
        if how in ("dead", "stuck"):
            return None
        surface = self.surfaces[self.pushes[servo]]
        surface.is_loose = how == "loose"
        self.last[self.pushes[servo]] = servo
        self.accepted[servo] = surface.push(value + (offset if how == "bias" else 0.0))
        return self.accepted[servo]

    def fail(self, servo: str, how: str, offset: float) -> None:
        """Make a servo fail; `how` is a `Failure`.

        If this servo was commanded last of the servos at its surface, the surface stops ("dead", "stuck") or
        floats ("loose"). With "bias", `offset` is added to each command from the next one on.
        """
        self.failed[servo] = how, offset
        surface = self.surfaces[self.pushes[servo]]
        if self.last.get(self.pushes[servo]) != servo:
            return
        surface.is_loose = how == "loose"
        if how in ("dead", "stuck"):
            surface.target = surface.position

    def heal(self, servo: str) -> None:
        """Repair a servo."""
        self.failed.pop(servo, None)

    def step(self, dt_s: float) -> None:
        """Move every surface for `dt_s`."""
        for surface in self.surfaces.values():
            surface.step(dt_s)
