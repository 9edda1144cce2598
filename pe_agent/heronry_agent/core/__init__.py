"""The part of the agent that decides: state machines without a clock, a socket, a thread, a process or a file."""
