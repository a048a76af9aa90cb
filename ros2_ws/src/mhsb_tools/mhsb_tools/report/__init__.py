"""Evaluation of a recording: motion, goals and energy, in numbers and figures."""
