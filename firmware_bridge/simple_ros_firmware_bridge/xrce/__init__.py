"""DDS-XRCE as an agent speaks it: values and machines, no input and no output."""
