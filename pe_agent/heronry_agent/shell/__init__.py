"""The part of the agent that has input and output: the loop, partitions, devices, files, the command line."""
