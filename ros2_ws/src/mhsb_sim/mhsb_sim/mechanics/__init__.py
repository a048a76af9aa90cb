"""The arm: its MuJoCo model, its robot description, its pictures."""
