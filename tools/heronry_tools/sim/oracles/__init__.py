"""The oracles: what must hold in every flight, verified from frames and from the truth; no core is asked."""
