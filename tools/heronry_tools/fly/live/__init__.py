"""Flights in real time: a plant process, agents on software buses, and the device driver between them."""
