"""The commands of `heronry`, one file each: arguments in, an exit code out; the packages beside this one do the
work.
"""
