"""Renderer of stereo streets in KITTI's layout with exact truth; the entry point is `cache.draw_scene`.

From a scene's settings to its images, each module uses those before it:

- `route`: the centre line of the street, and the drive of the camera;
- `textures`, `houses`, `vehicle_paint`: painted textures; `atlas`: all of them at all scales;
- `mesh`: flat textured faces; `site`, `things`, `city`, `street`: the street built of them;
- `shapes`, `vehicles`, `traffic`: vehicles and their motion; `world`: the complete scene;
- `render` and `antialias`: the view of a camera; `sensor`: its grey levels;
- `truth_files`, `scene_folder`, `cache`: the files.
"""
