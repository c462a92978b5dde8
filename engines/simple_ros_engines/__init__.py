"""The wireless engines: what robots know about their radio links, and what they make of it."""
