"""What the computer of a node without a table offers, as one line of JSON: object 2025h, read by `heronry adopt`.

The numbers are those of the whole computer at the start of the agent. A person decides how much of them a spec gives to
modules, so nothing is decided by them.

    version, python, machine     of heronry and of the interpreter; the kind of processor
    cores, ram_kib, disk_kib     processors, memory, free disk
    images                       the names in the installed catalogues of images
"""

import json
import os
import platform
import shutil
import sys
from pathlib import Path

from heronry_agent.shell.image_catalogues import catalogue_names
from heronry_wire.command_parser import program_version

_KIB = 1024


def offer() -> str:
    """Return the offer of this computer."""
    return json.dumps(
        {
            "version": program_version(),
            "python": platform.python_version(),
            "machine": platform.machine(),
            "cores": os.cpu_count() or 1,
            "ram_kib": os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // _KIB,
            "disk_kib": shutil.disk_usage(Path(sys.prefix)).free // _KIB,
            "images": catalogue_names(),
        }
    )
