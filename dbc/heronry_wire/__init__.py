"""All frames on the bus: CANaerospace data, the management protocol, identifiers, and CAN timing."""
