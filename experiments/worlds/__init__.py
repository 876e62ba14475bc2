"""What happens in a world: who is there, how they move, what is hidden, and a picture of it."""
