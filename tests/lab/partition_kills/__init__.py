"""Random kills of modules and agents, on real processes: each ends as declared, and no other process is affected."""
