"""One simulated flight and many: the aircraft, the injection of faults, the outcome, campaigns, shrinking."""
