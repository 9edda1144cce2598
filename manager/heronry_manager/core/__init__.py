"""All that decides in the manager: state machines without a clock, a socket, a thread, a solver or a file."""
