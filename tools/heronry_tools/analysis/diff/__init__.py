"""What changes between two specs: elements of the graph, and the consequences for each phase."""
