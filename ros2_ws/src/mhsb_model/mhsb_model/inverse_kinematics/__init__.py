"""Postures with the tip at a point: in closed form for three joints, and for chains of more."""
