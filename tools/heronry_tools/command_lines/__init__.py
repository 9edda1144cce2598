"""The command lines of `heronry`, one file for each command: what `--help` needs, and no more."""
