"""Gripper driver: turns the grasp bit into motor goals and motor readings into a gripper state."""
