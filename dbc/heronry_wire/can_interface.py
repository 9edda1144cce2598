"""A CAN interface of this computer, as the kernel describes it, and its restart: down and up again.

The description comes by rtnetlink (Linux, rtnetlink(7), linux/if_link.h, linux/can/netlink.h). Every user may read it.
Only a process with CAP_NET_ADMIN may change the interface. The description has what `ip -details link show` prints, but
that program is not needed. A value that the driver does not report is None. A vcan has no controller, so its bit rate,
state, restart time and counters are None.

A controller that is bus-off is restarted by setting its interface down and up, which works with every driver. The
command IFLA_CAN_RESTART would disturb other programs on the interface less, but some drivers do not support it. The
other programs lose nothing when the interface goes down: they cannot use an interface that is bus-off.
"""

import errno
import socket
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass

from heronry_wire.controller import ControllerState

_NEW_LINK, _GET_LINK, _ERROR = 16, 18, 2
_REQUEST, _ACKNOWLEDGE = 0x1, 0x4
_IFF_UP, _ARPHRD_CAN = 0x1, 280
_HEADER = struct.Struct("=IHHII")  # length, type, flags, sequence, port
_LINK = struct.Struct("=BxHiII")  # family, type, index, flags, mask of the flags to change
_NAME, _QUEUE, _LINK_INFO = 3, 13, 18
_KIND, _DATA, _STATISTICS = 1, 2, 3
_BIT_TIMING, _STATE, _RESTART_MS, _COUNTERS = 1, 4, 6, 8
_COUNTS = struct.Struct("=6I")  # bus errors, warnings, passive, bus-off, arbitrations lost, restarts
_NESTED = 0x3FFF  # the two highest bits of an attribute's type are flags
_BUFFER_BYTES = 32_768


@dataclass(frozen=True, slots=True)
class CanInterface:
    """Values of one interface; None where this kind of interface, or its driver, does not report a value."""

    name: str
    kind: str  # can, vcan, vxcan
    is_can: bool
    is_up: bool
    queue_length: int  # frames, "txqueuelen"
    bitrate: int | None = None  # bit/s
    state: ControllerState | None = None
    restart_ms: int | None = None  # after which Linux restarts a controller that is bus-off; 0: never
    transmit_errors: int | None = None  # the controller's counters, 0..255
    receive_errors: int | None = None
    bus_offs: int | None = None  # since the driver was loaded


def read_interface(name: str) -> CanInterface | None:
    """Read an interface from the kernel; None if no interface has that name.

    Raises OSError if the kernel reports another error.
    """
    body = _LINK.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + _attribute(_NAME, name.encode() + b"\0")
    try:
        return parse_link(_ask(_GET_LINK, _REQUEST, body))
    except OSError as error:
        if error.errno == errno.ENODEV:
            return None
        raise


def take_down_and_up(name: str) -> None:
    """Restart an interface, and with it its controller.

    Raises PermissionError without CAP_NET_ADMIN, and another OSError if the restart fails for another reason.
    """
    for flags in (0, _IFF_UP):
        body = _LINK.pack(socket.AF_UNSPEC, 0, socket.if_nametoindex(name), flags, _IFF_UP)
        _ask(_NEW_LINK, _REQUEST | _ACKNOWLEDGE, body)


def obstacle(name: str, bitrate: int | None) -> str | None:
    """Return the reason why an interface that is up should not be used now; None if there is no such reason.

    None, too, if the interface does not exist or is down: an attempt to open it then gives the reason.

    A controller that is bus-off is a reason if Linux is set to restart it. If Linux is not, this function restarts
    the interface. If the restart succeeds, the result is None; if it fails, the controller is the reason.

    bitrate: bit rate that the bus must have; another bit rate of the interface is a reason. None: any bit rate.
    """
    interface = read_interface(name)
    if interface is None or not interface.is_up:
        return None  # an attempt to open the interface gives the reason
    if interface.state is ControllerState.BUS_OFF:
        return _restarted(interface)
    if bitrate is not None and interface.bitrate not in (None, bitrate):
        mend = f"ip link set {name} down && ip link set {name} up type can bitrate {bitrate}"
        return f"the interface runs at {interface.bitrate} bit/s, and this bus at {bitrate}: '{mend}'"
    return None


def _restarted(interface: CanInterface) -> str | None:
    name = interface.name
    if interface.restart_ms:
        return f"its controller is bus-off; Linux restarts it after {interface.restart_ms} ms"
    try:
        take_down_and_up(name)
    except OSError:
        mend = f"ip link set {name} down && ip link set {name} up type can restart-ms 100"
        return f"its controller is bus-off, and this user may not restart it: '{mend}'"
    return None


def parse_link(body: bytes) -> CanInterface:
    """Read the body of an RTM_NEWLINK message."""
    _, hardware, _, flags, _ = _LINK.unpack_from(body)
    outer = dict(_attributes(body[_LINK.size :]))
    info = dict(_attributes(outer.get(_LINK_INFO, b"")))
    can = dict(_attributes(info.get(_DATA, b""))) if info.get(_KIND, b"").rstrip(b"\0") == b"can" else {}
    state, counters = _number(can.get(_STATE)), can.get(_COUNTERS)
    transmit, receive = struct.unpack_from("=HH", counters) if counters else (None, None)
    statistics = info.get(_STATISTICS, b"")
    return CanInterface(
        name=outer[_NAME].rstrip(b"\0").decode(),
        kind=info.get(_KIND, b"").rstrip(b"\0").decode(),
        is_can=hardware == _ARPHRD_CAN,
        is_up=bool(flags & _IFF_UP),
        queue_length=_number(outer.get(_QUEUE)) or 0,
        bitrate=_number(can.get(_BIT_TIMING)) or None,
        state=ControllerState(state) if state is not None and state in set(ControllerState) else None,
        restart_ms=(_number(can.get(_RESTART_MS)) or 0) if can else None,
        transmit_errors=transmit,
        receive_errors=receive,
        bus_offs=_COUNTS.unpack_from(statistics)[3] if can and len(statistics) >= _COUNTS.size else None,
    )


def _number(value: bytes | None) -> int | None:
    return int.from_bytes(value[:4], sys.byteorder) if value else None


def _attribute(kind: int, value: bytes) -> bytes:
    length = 4 + len(value)
    return struct.pack("=HH", length, kind) + value + bytes(-length % 4)


def _attributes(block: bytes) -> Iterator[tuple[int, bytes]]:
    while len(block) >= 4:
        length, kind = struct.unpack_from("=HH", block)
        if length < 4:
            return
        yield kind & _NESTED, block[4:length]
        block = block[-(-length // 4) * 4 :]


def _ask(kind: int, flags: int, body: bytes) -> bytes:
    """Send one rtnetlink request and give the body of the answer; raises OSError where the kernel refuses."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        kernel.sendto(_HEADER.pack(_HEADER.size + len(body), kind, flags, 1, 0) + body, (0, 0))
        answer = kernel.recv(_BUFFER_BYTES)
    length, answered, *_ = _HEADER.unpack_from(answer)
    content = answer[_HEADER.size : length]
    if answered == _ERROR:
        (code,) = struct.unpack_from("=i", content)
        if code:
            raise OSError(-code, errno.errorcode.get(-code, "unknown"))
    return content
