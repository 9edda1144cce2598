"""Drills: one real node alone on a bus, and everybody else on it played by the book, rightly and wrongly.

Flights rarely bring a node to what it must refuse, or to the last millisecond of what it may wait. A drill does: it is
a short story in virtual time, told in frames. It knows docs/protocol.md and asks no core; what it judges are frames,
and when they came.

    pe_*          a PE, with a manager and neighbours that are played
    manager_*     a manager, with PEs and another manager that are played
"""
