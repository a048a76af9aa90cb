"""Hours of goals, stops, kills and faults, and the promises that have to be kept all the while."""
