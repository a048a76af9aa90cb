"""The simulated machine in lock-step, and the receiver of its plans."""
