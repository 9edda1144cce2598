"""The commands of `heronry`, one file each: arguments in, an exit code out; other packages do the work.

A command is imported when its command line has been read (`command_table`), so all that it needs stands at the head of
its file.
"""
