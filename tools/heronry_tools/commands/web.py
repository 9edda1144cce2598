"""`heronry web`: serve a page that shows a running or recorded system in a browser.

Exit codes: 0 the page was served until the command was stopped; 2 the page cannot be served.
"""

import argparse

from heronry_tools.web.opening import serve_what


def run(arguments: argparse.Namespace) -> int:
    """Serve until a signal comes; returns 0."""
    serve_what(arguments)
    return 0
