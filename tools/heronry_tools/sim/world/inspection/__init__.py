"""Somebody with tools for CANopen and CANaerospace at one PE: what is read, written and got wrong, topic by topic."""
