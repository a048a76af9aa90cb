"""The arm: its MuJoCo model, its inverse dynamics, its pictures."""
