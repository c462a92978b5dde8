"""The control plane as values: generated messages, the table of calls, conversions. No input or output."""
