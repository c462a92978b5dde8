"""The control loop of robot_xl: hardware interfaces, the mecanum drive controller, broadcasters."""
