"""robomimic on exported data: whether it trains, and how fast beside LEGATO."""
