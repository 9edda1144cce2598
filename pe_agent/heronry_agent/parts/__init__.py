"""Parts for fault tolerance: modules that need only the names of what they read, give and report as failed.

A part is subclassed, and the class attributes are set; the subclass is the image. The images `redundancy` of the
shipped aircraft have one of each, and `dg_specs/examples/redundant_data` and `watched_actuator` fly them.

For all parts: a datum that is missing, invalid or not a number is ignored, and no element is reported for it. An
element is reported only after its fault has lasted for `patience_ns` without a break, so not within that time after a
start, when some data are fresh and others on their way. A report is repeated only after the fault has lasted for that
time again. The manager latches it, so a repetition after a restart changes nothing, and a restart delays a report by
`patience_ns` at most.
"""
