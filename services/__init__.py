"""One package per process; they never import each other."""
