"""What the standards say about a radio link: tables, sizes and a model of block errors. Pure."""
