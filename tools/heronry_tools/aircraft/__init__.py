"""The shipped aircraft: the images of its modules, and the plant that its simulated devices read and move."""
