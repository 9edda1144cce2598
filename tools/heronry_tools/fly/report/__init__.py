"""Pictures of flights: an HTML file with SVG, which needs no other file."""

from heronry_tools.fly.report.dispersion_page import dispersion_page
from heronry_tools.fly.report.flight_page import flight_page

__all__ = ["dispersion_page", "flight_page"]
