"""What people and other programs read: plans, buses, status and events in words; pictures; DBC files."""
