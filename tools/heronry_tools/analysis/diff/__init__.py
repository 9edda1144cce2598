"""What changes between two specs: in the graph, and in consequence."""
