"""Data sets in the formats of others. See docs/data.md."""
