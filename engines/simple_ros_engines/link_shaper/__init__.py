"""Simulated radio between real nodes: the shell around `simple_ros_engines.simulator.shaper`."""
