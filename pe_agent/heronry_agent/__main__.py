"""`python -m heronry_agent` is `pe-agent`."""

import sys

from heronry_agent.cli import main

sys.exit(main())
