"""Files for a node's computer: units of systemd, and files of networkd for its CAN interfaces."""
