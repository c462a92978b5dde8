"""The Cross Domain Engine: what radio links mean for a robot."""
