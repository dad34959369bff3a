"""Code shared by the measure_… scripts."""
