"""A radio that is none: every record it makes is marked simulated."""
