"""The source that a view watches: a manager on this computer, a bus, a recording, or a scenario that is flown now.

A log has frames only. Why the manager decided so comes from running its core again (`sim.replay`), and a scenario is
flown by the simulator. So this room stands above both the views (`watch`) and the simulator, and neither knows the
other.

    arguments     the arguments that name a source, on every command line alike
    opened        opens what they name
    recordings    a recorded flight, with the events that its frames show and the causes that a replay finds
"""
