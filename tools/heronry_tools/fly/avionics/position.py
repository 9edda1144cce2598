"""Modules that estimate the position of the aircraft, from a receiver alone or with the rover's images.

Positions are in the runway's frame; the height is that of the wheels above the runway. The version of a position in the
spec tells its accuracy:

    1   from the differential receiver             good enough to land
    2   from the filter, while it gets images      good enough to land
    3   from the filter, without images            not good enough
    4   from the receiver, without corrections     not good enough

Without velocity these modules publish nothing: a receiver gives only 10 positions a second, too few to steer by.

The tracking filter doubts itself when images no longer fit (`tracking_filter`). If it does so a third time, its
position cannot be trusted although it goes on: the module reports itself as failed, with the number of resets as
detail, so that the next plan takes the position from another module.

A restart of a receiver's estimator loses nothing. With a checkpoint in the spec, the tracking filter goes on from its
last state, carried forward by the velocity. Without a state it loses what it has learnt from images: it begins at the
receiver's position, or, without a receiver, where the line of sight of an image meets the nominal approach, and needs
some seconds of images to be accurate again. A change of the mode loses nothing.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number, numbers
from heronry_tools.fly.avionics.tracking_filter import H, TrackingFilter, X, Y

NS_PER_S = 1_000_000_000
# x, y, height of the camera (m). The height of the aircraft's centre above its wheels is subtracted from the height.
CAMERA_M = (100.0, 12.0, 0.3)
_SINKS_M_PER_S = 0.5  # an aircraft that sinks less is on the level part of the approach
_WAITS_NS = 300_000_000  # how long to wait for the receiver before the filter begins by an image alone
_STEEPEST_RAD = 0.12  # largest elevation of an aircraft on approach; an image with a larger elevation is wrong
_SETTLES_S = 1.0
_APART_NS = 20_000_000  # angles and age of one image arrive within this time
_MRAD_TENTHS = 10_000.0
_MOST_RESETS = 3


def velocity(inputs: Inputs) -> tuple[float, float, float] | None:
    """Return the velocity along x, along y and upwards (m/s); None if a component is missing."""
    north, east, up = (number(inputs, f"velocity_{axis}") for axis in ("north", "east", "up"))
    return None if north is None or east is None or up is None else (north, east, up)


def _position(inputs: Inputs, receiver: str) -> tuple[float, float, float] | None:
    x, y, height = (number(inputs, f"{receiver}_{axis}") for axis in ("x", "y", "height"))
    return None if x is None or y is None or height is None else (x, y, height)


class _ReceiverPosition(Module):
    """Estimates the position from the positions that a receiver gives and, between two of these, from the velocity."""

    receiver: ClassVar[str]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._held: list[float] | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the position."""
        fix, moving = _position(inputs, self.receiver), velocity(inputs)
        if moving is None or (fix is None and self._held is None):
            return {}
        period_s = self.ctx.period_ns / NS_PER_S
        if self._held is None:
            assert fix is not None
            self._held = list(fix)
        for i, speed in enumerate(moving):
            self._held[i] += speed * period_s
            if fix is not None:
                self._held[i] += (
                    (fix[i] + speed * _age_s(inputs, self.receiver) - self._held[i]) * period_s / _SETTLES_S
                )
        x, y, height = self._held
        return {"position_x": x, "position_y": y, "height": height}


def _age_s(inputs: Inputs, receiver: str) -> float:
    datum = inputs.get(f"{receiver}_x")
    return 0.0 if datum is None else datum.age_ns / NS_PER_S


class DifferentialPosition(_ReceiverPosition):
    """Publishes the position from the receiver `differential`, which gets corrections: good enough to land."""

    receiver = "differential"


class SatellitePosition(_ReceiverPosition):
    """Publishes the position from the receiver `gps`, which gets no corrections: not good enough to land."""

    receiver = "gps"


class TrackedPosition(Module):
    """Publishes the position from the tracking filter; in mode `coasting` the filter gets no new images."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self.filter: TrackingFilter | None = None
        self._image_ns = 0  # exposure of the last image that was used
        self._fix_age_ns = 0
        self._since_ns = ctx.now_ns

    def mode_changed(self) -> bool:
        """Keep this object, with the state of its filter, when the mode changes; returns True."""
        return True

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Advance the filter by the velocity, give it the new measurements, and publish its position."""
        moving, now_ns = velocity(inputs), self.ctx.now_ns
        fix = _position(inputs, "gps")
        if moving is None:
            return {}
        if self.filter is None:
            self.filter = self._begun(inputs, fix, moving)
            if self.filter is None:
                return {}
        self.filter.advance(moving, now_ns)
        if fix is not None:
            self._use_fix(self.filter, fix, inputs["gps_x"].age_ns, moving)
        self._use_image(self.filter, inputs)
        if self.filter.resets >= _MOST_RESETS:
            self.ctx.report_failed(f"module:{self.ctx.module}", self.filter.resets)
        state = self.filter.state
        return {"position_x": state[X], "position_y": state[Y], "height": state[H]}

    def save(self) -> tuple[float, ...]:
        """Return the state of the filter; nothing while there is no filter, or one that cannot be trusted."""
        if self.filter is None or self.filter.resets >= _MOST_RESETS:
            return ()
        return self.filter.numbers()

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:
        """Go on from a state of the filter; the next step carries it forward by its age."""
        self.filter = TrackingFilter.of_numbers(CAMERA_M, state, self.ctx.now_ns - age_ns)

    def _begun(
        self, inputs: Inputs, fix: tuple[float, float, float] | None, moving: tuple[float, float, float]
    ) -> TrackingFilter | None:
        """Return a filter that begins at the receiver's position, or else on the line of sight of an image.

        Without a position of the receiver, return None in these cases:

            - there is no image
            - this module has not yet waited long enough for the receiver (`_WAITS_NS`)
            - the elevation in the image cannot be that of an aircraft on approach
        """
        now_ns, angles = self.ctx.now_ns, numbers(inputs, "image_angles", 2)
        if fix is not None:
            return TrackingFilter(CAMERA_M, fix, now_ns)
        if angles is None or now_ns - self._since_ns < _WAITS_NS:
            return None
        elevation_rad = angles[1] / _MRAD_TENTHS
        if not 0.0 < elevation_rad < _STEEPEST_RAD:
            return None
        return TrackingFilter.by_sight(CAMERA_M, elevation_rad, now_ns, sinks=moving[2] < -_SINKS_M_PER_S)

    def _use_fix(
        self, tracking: TrackingFilter, fix: tuple[float, ...], age_ns: int, moving: tuple[float, ...]
    ) -> None:
        is_new = age_ns < self._fix_age_ns or not self._fix_age_ns
        self._fix_age_ns = age_ns
        if is_new:
            tracking.use_receiver([at + speed * age_ns / NS_PER_S for at, speed in zip(fix, moving, strict=True)])

    def _use_image(self, tracking: TrackingFilter, inputs: Inputs) -> None:
        """Give the filter each image once.

        Angles and age of an image are separate data; they are used if both have arrived at nearly the same time.
        """
        angles, age_ms = numbers(inputs, "image_angles", 2), number(inputs, "image_age")
        if angles is None or age_ms is None:
            return
        age_ns = inputs["image_angles"].age_ns
        if abs(age_ns - inputs["image_age"].age_ns) > _APART_NS:
            return
        exposed_ns = self.ctx.now_ns - age_ns - round(age_ms) * 1_000_000
        if exposed_ns - self._image_ns < 2 * _APART_NS:
            return
        self._image_ns = exposed_ns
        tracking.use_image(angles[0] / _MRAD_TENTHS, angles[1] / _MRAD_TENTHS, exposed_ns)
