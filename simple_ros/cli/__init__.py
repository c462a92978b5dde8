"""The command ``simple-ros``: one file per noun.

A command that asks for help, or only reads a file, shall not wait for gRPC: what is heavy is
imported inside the command that needs it.
"""
