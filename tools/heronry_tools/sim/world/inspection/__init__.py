"""A diagnostic client at one PE, with CANopen and CANaerospace: what it reads, writes and gets wrong, by topic."""
