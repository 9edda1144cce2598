"""Flight dynamics models in JSBSim; the only part of the product that imports it."""
