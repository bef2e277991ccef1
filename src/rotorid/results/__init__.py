"""What is made of an estimate."""
