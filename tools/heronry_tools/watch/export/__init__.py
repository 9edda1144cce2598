"""A recorded flight for other tools: MCAP for Foxglove, Lichtblick and PlotJuggler, MDF 4 for asammdf."""
