"""Component graphs of polymorphic control: what a control system is made of, how it is rewired, how it is assessed."""
