"""All of the agent that touches the world: the loop, partitions, devices, files, the command line."""
