"""What every command shares: errors, progress, tables of text, files that are whole or absent, the SPEC argument."""
