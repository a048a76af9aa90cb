"""The suite as running processes: started, loaded, commanded and watched from outside."""
