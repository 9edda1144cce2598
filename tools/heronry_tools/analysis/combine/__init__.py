"""Two vehicles' specs become one: what is decided (`joining`), and how the one file is written (`writing`)."""
