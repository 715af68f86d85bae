"""How soon a moving robot is at rest after a fault, and how well it holds, over processes."""
