"""Actions: goals that take a while, with feedback on the way and a result at the end.

An action ``fibonacci`` is three services and two topics below ``fibonacci/_action``, named as in ROS 2:
``send_goal``, ``cancel_goal`` and ``get_result``, ``feedback`` and ``status``. `states` and `book` are pure:
what a goal may go through, and what a server keeps of its goals. `messages` makes the messages that wrap
a user's. `server` and `client` carry bytes and time.
"""
