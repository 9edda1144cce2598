"""A CAN bus in software: a hub process on a UNIX socket and a python-can interface, `softbus`.

It is for computers whose kernel has no CAN: frames contend by priority and occupy the bus for their exact time
at its bit rate, so load and latency are those of a wire. `line.py` decides which frame is sent and when, `hub.py`
serves the clients, `client.py` is the python-can interface, `place.py` finds a bus by its name. `heronry softbus`
(`serving.py`) runs a hub from a shell, `starter.py` from Python.
"""
