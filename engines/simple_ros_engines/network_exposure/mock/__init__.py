"""A mobile network that is none: all it says is simulated."""
