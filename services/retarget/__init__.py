"""Retargeting: from the wanted motion of the gripper to joint motion of a robot."""
