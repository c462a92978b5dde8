"""Measurements: what ``simple-ros bench`` runs, and the ground under ``benchmarks/``.

Two processes, one that sends and one that receives, are started anew for each run and each peer, ours and
others alike; see `program` for what they say to each other, and `running` for who starts them.
Modules that the programs of other middleware use (`workloads`, `payloads`, `sink`, `source`, `program`) import
nothing of this library but generated messages.
"""
