from __future__ import annotations

import os

# Not skipped but not collected: no package of those programs exists, so most people cannot run these.
_CPP = ["test_cpp_programs.py", "test_foxglove_cpp.py"]
collect_ignore = [] if os.environ.get("SIMPLE_ROS_CPP_BIN") else _CPP
