"""MuJoCo world, ray camera, low-level servos, episode state machine, ground truth."""
