"""What a recording of a bus holds: read from frames and files, without a simulator, a manager's core or a planner.

    recorded_folder    a folder of `heronry record`: frames, events, spec and versions
    masterships        the masterships in a log, and what each commanded and heard
    commanded          the configurations that managers have commanded, put together from PREPARE and slices
    proven             with a key: the frames that are proven
    another_spec       finds that a recording was made with another spec

Replays, oracles of the simulator and views of a system stand above and use it.
"""
