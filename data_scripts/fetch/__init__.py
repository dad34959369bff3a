"""Getting data: downloads, KITTI's archives and raw drives, detectors, stereo images of one's own."""
