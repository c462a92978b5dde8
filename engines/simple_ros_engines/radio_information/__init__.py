"""The Radio Information Engine: what is known about each radio link."""
