"""simple_ros: robot middleware in pure Python that treats the wireless link as part of the robot."""
