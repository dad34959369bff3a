"""Vehicle boxes from a detection network in an ONNX file (chapter 5).

Read `yolo` first: its `YoloDetector` runs a network on an image. On the way from the image to the boxes are

- `network_image`: the image scaled, and with borders, for the network;
- `outputs`, `readers` and `metadata`: which network this is, and how its outputs are read;
- `suppression`: one box for each object.

`models` finds a detector by its name (the kit's own is in the folder `models`), and `model_files` lists the
files of one. `label_folders` writes the boxes of a sequence as label files, which a run reads. `settings` has
the thresholds.
"""

import os

# This variable disables ONNX Runtime's telemetry, if it is set before the runtime is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
