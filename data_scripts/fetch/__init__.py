"""Download and import of data: KITTI's archives and raw drives, detectors, a user's stereo images."""
