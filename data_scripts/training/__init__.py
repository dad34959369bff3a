"""Training a vehicle detector: data sets in YOLO form, network, loss, loop and export (extra `[train]`)."""
