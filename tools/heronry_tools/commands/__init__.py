"""The commands of `heronry`, one file each: arguments in, an exit code out; the work is done in the rooms below."""
