"""The Physical Adaptive Engine: how to send on a link."""
