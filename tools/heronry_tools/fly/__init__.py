"""Flights of aircraft in the flight dynamics model JSBSim, with their avionics on simulated or real PEs.

docs/flights.md explains these flights. The modules in `avionics` run on PEs, and import no other part of
`heronry_tools`. Only `dynamics` imports jsbsim, which the extra `[fly]` installs.
"""
