"""Inverse kinematics: postures with the tip at a point, for three joints and for longer chains."""
