"""Forces of magnets: their laws, what goes through a law, dynamics of channels."""
