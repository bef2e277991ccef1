"""What every part stands on: errors, values, units, files, tables, distributions."""
