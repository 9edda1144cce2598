"""Programs for this computer: software bus, manager process, demo, doctor, vcan, units for systemd."""
