"""Output for people and for other programs: plans, buses, status and events as text; pictures; DBC files."""
