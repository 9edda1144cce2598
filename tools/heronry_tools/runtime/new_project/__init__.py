"""`heronry new`: writes the files of a first node, from the templates beside this file.

In the names and the content of the templates, NAME stands for the name of the project. The units of systemd are those
of `heronry_tools.runtime.deployment`; a drop-in adds what a node with devices needs.
"""
