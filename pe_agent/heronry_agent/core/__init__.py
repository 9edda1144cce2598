"""All decisions of a PE: state machines without a clock, a socket, a thread, a process or a file."""
