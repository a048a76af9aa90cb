"""Linkages between cylinder and joint: cylinder length and moment arm over the joint angle."""
