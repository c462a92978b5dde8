"""Message packages, the registry that finds a message by name, and numpy views of array fields.

Each package is a module: ``from simple_ros.msg.geometry_msgs import Twist``. Importing this package
imports none of them, and none of them imports numpy; only ``simple_ros.msg.arrays`` does.
"""
