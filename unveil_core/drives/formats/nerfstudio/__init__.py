"""Parts of the reader of transforms.json: keys, lenses, cameras of a rig, points, depth images."""
