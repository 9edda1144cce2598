"""The part of the manager that decides: state machines without a clock, a socket, a thread, a solver or a file.

Each room decides one thing. A room imports only what stands below it; rooms in one line do not know each other.

    manager                               the core as its driver sees it: `step`, `next_deadline_ns`, `validate`
    intake                                what follows from each frame, order and change
    planning, heartbeat                   when a plan is requested and deployed; what goes out in each period
    knowledge                             all that is forgotten when the manager falls silent or stands by
    reports, provisioning                 what people are told, no decision depends on it; tables for PEs without one
    mastership                            whether this manager is the active one
    situation, epochs, authentication     what has failed; what runs; what has been proven
    membership                            which PEs are available, and what the others may still drive
    tables                                what names mean on the wire

Below the rooms stand the vocabulary of the core (`vocabulary`, `settings`), the effects of one step (`turn`), what
survives a restart (`memory`), tables of transitions (`transitions`), the routes of a spec (`topology`), and the clients
that read and write objects of PEs (`sdo_client`).
"""
