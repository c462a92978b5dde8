"""Parameters: values and their tree (pure), YAML text, the calls to the Master, a node's own ones."""
