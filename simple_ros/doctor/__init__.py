"""``simple-ros doctor``: facts about this host, this installation and the graph, and what they mean.

Modules named ``judge_*`` are pure: from facts to findings. Modules named ``look_*`` gather the facts;
each look has a deadline of its own, since a doctor is called when something hangs.
"""
