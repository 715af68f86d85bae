"""Serving of learned policies: from checkpoints and frames to actions. Needs no torch by itself."""
