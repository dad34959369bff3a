"""Sequences: images, camera, times, true poses and vehicle boxes, from folders in KITTI's layout.

Read `sequence` first: a `Sequence` is what a run receives, and `catalogue` opens one by name. Behind it are

- `kitti` and `masks`: calib.txt, times.txt, part.txt and the images;
- `label_files`, `label_names` and `class_names`: boxes in YOLO's text files, where the names of their classes
  come from, and which classes count (chapter 5); `label_remarks` has what a person is told about them;
- `poses`: files of paths, in the formats of KITTI and TUM or as arrays; `tables`: CSV files.

Beside it are `scenes`, `drawn`, `scene_files` and `truth`: drawn streets by name, their folders, the files in
these, and what is known of their vehicles. `image_hashes` has the digests of images, by which runs and labels
are known to belong to these images.
"""
