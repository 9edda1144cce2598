"""Conformance tests: one real node alone on a simulated bus; the test plays all other nodes, correct and faulty.

Flights rarely bring a node to a frame that it must refuse, or to the last millisecond of a time limit. A conformance
test does: it is a short story in virtual time, told in frames. The test follows docs/protocol.md and reads no state of
a core; it checks frames and the times at which they came. The name of a test says what the node must do, its docstring
when and how.

    pe_*          a real PE; the manager and the neighbours are played
    manager_*     a real manager; the PEs and another manager are played
"""
