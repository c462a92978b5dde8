"""The Pico bridge: boards with micro-ROS firmware as part of a simple_ros graph."""
