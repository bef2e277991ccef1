"""The estimate: its parts, its status, its file, and what it predicts."""
