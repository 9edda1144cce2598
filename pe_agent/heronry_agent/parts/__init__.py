"""Ready-made modules for fault tolerance: the author of a module only names the variables and elements.

To use such a part, subclass it and set its class attributes. The subclass is the image of a module.
`heronry_tools.aircraft.images.redundancy` has an image of each part. The examples `redundant_data`, `comparators` and
`watched_actuator` in `dg_specs/examples` use these images.

All parts ignore a datum that is missing, invalid or not a number, and report no element for it. A part reports an
element as failed only after the fault has lasted for `patience_ns` without a break. So nothing is reported just after a
start, when some data have come and others have not. While the fault lasts, the report is repeated every `patience_ns`.
The manager latches the fault, so a repetition changes nothing. A restart of the module delays the report by at most
`patience_ns`.

`states` has parts of another kind: a filter and an integrator, whose state a checkpoint keeps.
"""
