"""Parts for fault tolerance: complete modules, to which an author only gives names of variables and elements.

To use a part, subclass it and set its class attributes; the subclass is the image. The images `redundancy` of the
shipped aircraft have one of each part, and `dg_specs/examples/redundant_data`, `comparators` and `watched_actuator` use
them.

All parts ignore a datum that is missing, invalid or not a number, and report no element for it. A part reports an
element only after the fault has lasted for `patience_ns` without a break. So nothing is reported just after a start,
when some data have come and others have not. A report is repeated only after the fault has lasted for that time again.
The manager latches the fault, so a repetition changes nothing, and a restart delays a report by `patience_ns` at most.
"""
