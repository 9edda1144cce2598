"""Devices with a driver of their own: one process for each, so that no driver can disturb the agent or another device.

    agent                                    process of one device (`driver_process`)
    IsolatedDriver, IsolatedDevice           one SensorDriver or ActuatorDriver (`heronry_agent.device_driver`)
       (`isolated`)                             opens the hardware, reads, writes, takes the safe action
         |        shared memory (`shared_block`)   |
         |  ---- command, end of its validity -->  |
         |  <--- reading, alive word, position --  |
         +------ socket: wakes, and ends --------->+

The agent never waits for such a process. It reads the newest reading and writes the newest command in memory that both
share. The socket carries no data: a byte wakes a process that waits for its next command, and the end of the socket
tells that the agent has closed it, or has ended. The agent believes nothing that it reads: each entry has a check sum,
a reading that is no value, is not a finite number, is outside of `range`, comes from the future or is older than
`stale_ms` is no reading (`judgement`). A driver that writes too much into the memory overwrites its own entries only.

*What a sensor can do wrong, and what follows*

    raises, exits, is killed          the process is started again: at once, after 100 ms, then after twice as long each
                                      time. After RESTARTS failures, each within a minute of the one before, the device
                                      is reported failed, and the process is started only every SELDOM_NS
    hangs in a transfer               no sign of life for longer than the driver declares: the process is killed, and
                                      what is said above follows
    gives garbage, NaN, nothing       the module reads None. After `stale_ms` without a valid reading, the device is
                                      reported failed; its process goes on, and the report stops with a valid reading
    floods, is slow                   the newest reading counts, by its own time

A device is reported by the module that is stepped on it, as if the module had called `ctx.report_failed`; so the core
of the agent knows nothing of drivers.

*How an actuator ends safely.* Each command is valid until a time that stands beside it in the memory. While the module
runs and the PE is authorized, the agent renews this time, in every turn of its loop:

    a branch of a DEMUX       the end of the authorization, as protocol rule 6 has it at that moment
    any other actuator        T_lease from now

The process takes the safe action (`safe`: hold, release or a value) at the end of validity, by itself: whether the
agent was paused, killed, cut off, or hangs. It looks at the time immediately before each write, and again after it: if
the time has passed meanwhile, because the process was paused, the safe action follows at once. Only a write that is in
the kernel when the time ends can still come after it; and if a signal stops the process between its look and its write,
that write comes when the process goes on, with the safe action right behind it. When a process starts, its first act is
the safe action. If the agent ends, its processes take the safe action immediately, and end.

When a module stops, the agent orders the safe action, and tells the core of the agent when the process of a branch has
taken it (`core/modules/rests`).

*Signals.* A process ignores SIGINT, since Ctrl-C is for the agent. SIGTERM and the death of the agent
(PR_SET_PDEATHSIG) end it after the safe action; a sensor's process is killed. Only an open device can be made safe: so
an actuator's process is born with SIGTERM blocked, opens its device whatever comes (within 20 s, after which SIGALRM
ends it), and then obeys. An agent that ends in order starts a process once more if the last one was killed. Nobody is
left only if the agent dies between the death of a driver and its restart: then the actuator stays where it is until an
agent is started again, whose first act is the safe action.
"""
