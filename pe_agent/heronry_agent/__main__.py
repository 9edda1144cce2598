"""`python -m heronry_agent` is `pe-agent`."""

import sys

from heronry_agent.shell.cli import main

sys.exit(main())
