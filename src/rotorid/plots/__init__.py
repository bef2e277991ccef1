"""Pictures of plain numbers, in one style: the lowest floor of all that is drawn."""
