"""`heronry check` and its kin, and the families of rules that solve."""
