"""Records, and what is made of them: lines, tables, filtered samples, observations."""
