"""The metrics store: takes InfluxDB line protocol, keeps it in SQLite, answers two shapes of Flux."""
