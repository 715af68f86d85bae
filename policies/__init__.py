"""Trained policies that come with LEGATO: one folder each, written by `save_checkpoint`."""
