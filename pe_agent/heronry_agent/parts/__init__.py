"""Parts for fault tolerance: modules that are ready but for the names of what they read, give and accuse.

A part is subclassed, and the class attributes are set; the subclass is the image. The images `redundancy` of the
shipped aircraft have one of each, and `dg_specs/examples/redundant_data` and `watched_actuator` fly them.

What holds for all: a datum that is missing, invalid or no number counts for nothing and accuses nobody. Nothing is
accused for less than `patience_ns` without a break, and the first so long after a start is not judged: some data are
fresh then and others on their way. An accusation is said once, and again only after its cause was gone for as long. The
manager latches it, so saying it again after a restart changes nothing, and a restart loses no more than patience.
"""
