"""The only sockets of the library: thin shells around `simple_ros.wire` and the Master's calls."""
