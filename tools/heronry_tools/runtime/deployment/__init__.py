"""Files for a node's computer: systemd units, networkd files, and how to bring packages to a node without a network."""
