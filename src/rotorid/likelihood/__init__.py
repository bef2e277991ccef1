"""Maximum likelihood, and rival hypotheses where the data reject the model."""
