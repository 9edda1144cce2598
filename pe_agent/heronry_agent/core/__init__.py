"""The part of the agent that decides: state machines without a clock, a socket, a thread, a process or a file.

Each room decides one matter. A room imports only what stands below it; rooms in one line do not know each other.

    agent                          the core as its driver sees it: `step`, `next_deadline_ns`, `validate`
    deadlines                      when to act, and in which order
    inbound, command_acceptance,   which part takes a frame, which one executes a command, what the state frames say;
    condition, canopen             answers to tools of other makers
    modules                        what runs, when, and what follows when it fails
    checkpoints                    which state of a module is kept and sent, and with which one it starts
    configuration, authority       what is to run next; whose commands count, and what may be driven
    forwarding, reports            which frames go from bus to bus; what is told until it is acknowledged

Below the rooms stand the effects of one call (`turn`), look-ups in the table (`table_index`), the events and actions
(`vocabulary`), and three short rules that the processes of partitions and devices follow as well, without the rest of
the core: `restarts`, `step_times` and `unknown_names`.
"""
