"""What each kind of fault does to a flight: one file for each kind of target."""
