"""The families of rules of `heronry check` that need a solver, and the registry of all families."""
