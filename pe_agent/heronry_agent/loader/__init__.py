"""The memory loader of a PE: code comes over the bus, is checked, tried, and kept or taken back (protocol rule 10).

    code_loader   the agent's side: orders of the canopen room go in, what has become of them comes out; it never waits
    keeper        a short-lived process, which checks and writes; `cryptography` is imported there alone;
                  `keeper_process` starts it, and ends it if it hangs
    store         the states of the code on the disk, and how one follows from another
    folder        the file operations, each of which a crash leaves done or not done
    trial         whether new code has run for long enough, or has failed

*What is decided.* Which bundle (`heronry_wire.bundle`) the partitions of this PE import from. Partitions of modules
whose code is installed on the node are never touched.

*Who may change it.* Any SDO client that may write (with a key: after an UNLOCK) may bring a bundle and start it. A
bundle counts only with a right signature and a version above every one that was ever started here, so nobody else's
code and no older code is started, whoever sends it. What runs is not stopped: code is started only while no module of
the loader's partitions runs.

*What may go wrong.*

    a lost, late or doubled frame  is repaired by SDO; what is complete is checked again as a whole
    a restart during a transfer    it goes on where it was up to KEEP_NS (`programs`) before
    a forged frame                 spoils a transfer, which begins anew; it can neither sign code nor lower the floor
    a crash at any moment          the PE has the old code or the new code, whole
    a full or read-only disk       one sentence in the log, the error "write" in 1F57h; what was there stays
    a disk that hangs              the keeper is ended after a while, and that is told like a failed write
    new code that fails            the code before it is back at once (`trial`), and this version never returns
    new code that kills its agent  MOST_TRIES starts of the agent later the code before it is back

An agent without --code-dir imports none of these files.
"""
