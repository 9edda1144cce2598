"""A CAN bus in software: a hub process on a UNIX socket and a python-can interface, `softbus`.

It is for computers whose kernel has no CAN. Its load and latency are those of a wire: frames contend by priority, and
each frame occupies the bus for its exact time at the bit rate.

    line.py      decides which frame is sent and when
    hub.py       serves the clients
    client.py    is the python-can interface
    batches.py   is the port of a node: batches of frames, without messages of python-can
    place.py     finds a bus by its name
    serving.py   runs a hub from a shell (`heronry softbus`)
    starter.py   runs a hub from Python
"""
