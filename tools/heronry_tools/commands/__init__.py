"""The commands of `heronry`, one file each: arguments in, an exit code out; other packages do the work."""
