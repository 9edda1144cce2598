"""The dependency graph as a picture: the graph, its layout, and three ways to write it."""
