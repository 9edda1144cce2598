"""The oracles: what must hold in every flight, judged from frames and from the truth; no core is asked."""
