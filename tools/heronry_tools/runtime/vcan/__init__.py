"""`tools/with-vcan`: runs a command where a SocketCAN ``vcan0`` exists, even if this kernel cannot have one."""
