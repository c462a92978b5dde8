"""Turtles on a plane: a small process with a closed control loop over the network."""
