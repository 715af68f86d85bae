"""Training of learned policies: data in memory, windows, optimiser, run folder."""
