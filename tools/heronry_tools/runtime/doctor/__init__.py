"""The checks of `heronry doctor`, one file per place: the interface, the bus, the computer."""
