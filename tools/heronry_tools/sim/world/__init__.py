"""The simulated world: virtual time, buses with arbitration, controllers, and nodes that run the cores that fly."""
