"""Maximum likelihood: cost, solver, inference, nuisances, identifiability, suspects, bound."""
