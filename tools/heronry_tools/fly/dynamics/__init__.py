"""The models of the aircraft in JSBSim; no other part of the product imports JSBSim."""
