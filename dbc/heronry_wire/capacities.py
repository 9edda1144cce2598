"""Limits of a system on the bus: how many elements of each kind can be numbered in a frame or in a CANopen object.

Each limit follows from the width of the field that holds the number. An element beyond the limit cannot be addressed: a
slice that is too long would be refused each time it is sent, and two devices with the same number could not be told
apart. So `heronry check` and the compiler of tables refuse a spec beyond a limit (`heronry_dg.wire_limits`).

Other numbers need no limit in this file:

    node-IDs, identifiers      `identifiers` refuses what does not fit
    versions, restarts         the schema of a spec limits them; a version has four bits of the status byte
    terms                      after the largest term, there is an error
    epochs, sequence numbers   after the largest number, they begin anew
    contingencies              a contingency with a number above 4 095 is sent as slices
"""

from heronry_wire.canopen_objects import LARGEST_INDEX, MOST_ELEMENTS
from heronry_wire.identifiers import GATEWAY_IDS
from heronry_wire.management import SLICE_BODY, SLICE_BYTES_PER_FRAME

MOST_SLICE_BYTES = SLICE_BODY.largest("index") * SLICE_BYTES_PER_FRAME
"""Bytes of the slice of one PE: bodies 1 to 255 of SLICE, five bytes each."""

_SERVICE_CODES = 256  # byte 2 of a CANaerospace frame

MOST_DEVICES = _SERVICE_CODES
"""Devices of a system: the service code of an actuator's echo is the number of the device."""

MOST_MODES = _SERVICE_CODES
"""Modes of a module: the service code of an output echo is the number of the mode."""

MOST_MODULES = LARGEST_INDEX + 1
"""Modules of a system: the error history (1003h) has 12 bits for the number of an element."""

MOST_MODULES_OF_A_PE = MOST_ELEMENTS
"""Modules that may run on one PE: the sub-indices of the arrays of modules in its object dictionary."""

MOST_RADIOS = len(GATEWAY_IDS)
"""Wireless buses: each gateway reports on its radio under an identifier of its own."""
