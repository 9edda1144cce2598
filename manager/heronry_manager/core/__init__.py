"""The part of the manager that decides: state machines without a clock, a socket, a thread, a solver or a file."""
