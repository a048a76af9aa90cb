"""Spools without sensors: where join valves and diverters are, and how slow servo valves are."""
