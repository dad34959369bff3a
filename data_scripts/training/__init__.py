"""Data sets in YOLO format for the training of a vehicle detector (extra `[train]`)."""
