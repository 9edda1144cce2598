"""What every command shares: errors, progress, tables of text, files written whole or not at all, arguments."""
