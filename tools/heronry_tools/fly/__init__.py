"""Flights in a flight dynamics model: plants for the agents, the EAV's avionics, records, acceptance (docs/flights.md).

`avionics` runs on PEs and needs the agent alone. Only `dynamics` imports jsbsim, which the extra `[fly]` installs.
"""
