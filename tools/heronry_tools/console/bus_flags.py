"""The bus a command is on: what each kind of bus does not model."""

_MODELS = {
    "softbus": "a software bus: frame times, priority and load are true; no bit errors, no bus-off",
    "vcan": "vcan, whose frames are real but take no time: no load, no arbitration, no bit errors",
    "socketcan": "SocketCAN, the real thing",
    "virtual": "python-can's virtual bus, inside this process: no time, no arbitration, no errors",
}


def what_it_models(interface: str, channel: str) -> str:
    """Which bus this is and what it does not model, for people."""
    kind = "vcan" if interface == "socketcan" and channel.startswith("vcan") else interface
    return f"{interface} {channel}, {_MODELS.get(kind, 'through python-can')}"
