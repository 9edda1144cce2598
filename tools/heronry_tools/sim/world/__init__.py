"""The simulated world: virtual time, buses with arbitration, controllers, and nodes with the cores that fly."""
