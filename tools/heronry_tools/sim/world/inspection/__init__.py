"""A diagnostic client that inspects one PE by CANopen and CANaerospace; one file per topic of the inspection."""
