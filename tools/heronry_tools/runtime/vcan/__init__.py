"""Run a command where a SocketCAN ``vcan0`` exists, whatever this kernel can do (see ``tools/with-vcan --help``)."""
