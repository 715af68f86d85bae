"""Policies: scripted experts and control arms now, networks later, all behind one interface."""
