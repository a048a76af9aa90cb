"""What the arm keeps clear of, and how far it is from it."""
