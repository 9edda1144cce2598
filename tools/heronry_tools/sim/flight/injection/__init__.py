"""What each kind of fault does to a flight, in one file for each that it hits."""
