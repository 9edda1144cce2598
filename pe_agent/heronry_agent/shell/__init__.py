"""The parts of the agent with input and output: the loop, partitions, devices, files, the command line."""
