"""Mean opinion scores: how well a process goes, as people and programs judge it."""
