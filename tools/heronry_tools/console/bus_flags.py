"""Tells the user which kind of bus a command uses, and what this kind of bus does not model."""

SOFTWARE_BUS = "can0"  # name of a software bus where the user gives none
_MODELS = {
    "softbus": "a software bus: frame times, priority and load are exact; no bit errors, no bus-off",
    "vcan": "vcan: real frames that take no time; no load, no arbitration, no bit errors",
    "socketcan": "SocketCAN on real hardware",
    "virtual": "python-can's virtual bus inside this process: no frame times, no arbitration, no errors",
}


def what_it_models(interface: str, channel: str) -> str:
    """Describe a bus to the user: interface, channel, kind of bus, and what this kind does not model."""
    kind = "vcan" if interface == "socketcan" and channel.startswith("vcan") else interface
    return f"{interface} {channel}, {_MODELS.get(kind, 'through python-can')}"
