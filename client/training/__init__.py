"""`legato train`: what is to be trained, how far it is, and the checkpoint it ends in."""
