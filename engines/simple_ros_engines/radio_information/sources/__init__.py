"""Where metrics come from: one file per kind of source."""
