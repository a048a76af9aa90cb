"""Linkages between cylinder and joint: length and moment arm over the joint angle."""
