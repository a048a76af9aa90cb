"""What a recording tells: motion, goals and energy, in numbers and figures."""
