"""The check of a SocketCAN interface, by the values that the kernel gives for it."""

from collections.abc import Iterator

from heronry_tools.reports.findings import Finding
from heronry_wire.can_interface import CanInterface
from heronry_wire.controller import ControllerState

RESTART_MS = 100
LEAST_QUEUE = 10  # frames: Linux' own default for a controller
_ACTIVE_BELOW = 96  # of an error counter; from 96 on, the controller is in ERROR-WARNING (ISO 11898-1)


def assess_interface(name: str, interface: CanInterface | None, bitrate: int | None) -> Iterator[Finding]:
    """Yield findings about an interface.

    interface: the values that the kernel gives; None: there is no interface of this name.
    bitrate: bit rate of the spec's bus in bit/s; None: not known.
    """
    if interface is None:
        make = f"ip link add {name} type vcan && ip link set {name} up" if name.startswith("vcan") else "ip link"
        hint = (
            make if name.startswith("vcan") else f"{make}   (lists what there is; {name} needs its driver or overlay)"
        )
        yield Finding("interface", f"there is no interface {name}", hint)
    elif not interface.is_can:
        yield Finding("interface", f"{name} is no CAN interface", "ip -details link show type can")
    elif not interface.is_up:
        yield Finding("interface", f"{name} is down", _up(interface, bitrate))
    else:
        yield Finding("interface", f"{name} is up ({interface.kind or 'CAN'})")
        yield from _assess_controller(interface, bitrate)


def _assess_controller(interface: CanInterface, bitrate: int | None) -> Iterator[Finding]:
    name = interface.name
    if interface.queue_length < LEAST_QUEUE:
        says = f"{name} can queue only {interface.queue_length} frames: other programs will fail to send (ENOBUFS)"
        yield Finding("queue", says, f"ip link set {name} txqueuelen {LEAST_QUEUE}")
    else:
        yield Finding("queue", f"{name} can queue {interface.queue_length} frames; a node needs room for one")
    if interface.restart_ms is None:
        yield Finding("controller", f"{name} has no controller: no bit rate, no errors, no bus-off")
        return
    yield _assess_bitrate(interface, bitrate)
    if interface.restart_ms == 0:
        says = f"Linux leaves {name} bus-off for ever; where its driver cannot restart it, pe-agent must do so"
        yield Finding("restart", says, f"ip link set {name} down && {_up(interface, bitrate)}")
    else:
        yield Finding("restart", f"Linux restarts {name} {interface.restart_ms} ms after bus-off")
    yield from _assess_errors(interface, bitrate)


def _assess_bitrate(interface: CanInterface, bitrate: int | None) -> Finding:
    name, own = interface.name, interface.bitrate
    if own is None:
        return Finding("bit rate", f"the driver of {name} does not tell its bit rate")
    if bitrate is not None and own != bitrate:
        says = f"{name} runs at {own} bit/s, the spec's bus at {bitrate}: each would destroy the other's frames"
        return Finding("bit rate", says, f"ip link set {name} down && {_up(interface, bitrate)}")
    return Finding("bit rate", f"{name} runs at {own} bit/s" + (", as in the spec" if bitrate is not None else ""))


def _assess_errors(interface: CanInterface, bitrate: int | None) -> Iterator[Finding]:
    name, state = interface.name, interface.state
    look = "check termination (120 ohm at both ends), wiring, and the bit rate of every node"
    if state is ControllerState.BUS_OFF:
        yield Finding("errors", f"{name} is bus-off", f"ip link set {name} down && {_up(interface, bitrate)}")
        return
    counters = (interface.transmit_errors or 0, interface.receive_errors or 0)
    told = "" if interface.transmit_errors is None else f", error counters {counters[0]} (sent), {counters[1]} (heard)"
    word = "ERROR-ACTIVE" if state is None else state.name.replace("_", "-")
    is_well = state in (None, ControllerState.ERROR_ACTIVE) and max(counters) < _ACTIVE_BELOW
    yield Finding("errors", f"{name} is {word}{told}", None if is_well else look)
    if interface.bus_offs:
        yield Finding("bus-off", f"{name} has been bus-off {interface.bus_offs} times since it was created", look)


def _up(interface: CanInterface, bitrate: int | None) -> str:
    if interface.kind in ("vcan", "vxcan"):
        return f"ip link set {interface.name} up"
    rate = bitrate or interface.bitrate
    return f"ip link set {interface.name} up type can bitrate {rate or 'RATE'} restart-ms {RESTART_MS}"
