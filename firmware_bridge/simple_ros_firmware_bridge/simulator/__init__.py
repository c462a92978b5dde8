"""A board that does not exist: its XRCE client, its physics, its end of a serial line.

Nothing here uses the code of the agent, so that a mistake there is not repeated here and hidden.
"""
