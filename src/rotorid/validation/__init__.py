"""How well an estimate predicts."""
