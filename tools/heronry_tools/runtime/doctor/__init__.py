"""What `heronry doctor` looks at, one file per place: the interface, the bus, the computer."""
