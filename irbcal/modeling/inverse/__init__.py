"""Inverse kinematics: how does the robot get there."""
