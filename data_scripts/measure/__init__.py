"""What the measure_… scripts share."""
