"""Many identifications as one job: what varies, cases, workers, rows in a folder, their summary."""
