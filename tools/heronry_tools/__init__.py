"""The tools around manager and agent: command line, analyses, reports, software bus, simulator, demo."""
