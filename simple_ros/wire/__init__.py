"""The wire as pure code: bytes in, values out, time as an argument."""
