"""`legato demo record`: demonstrations by the scripted expert, in parallel processes."""
