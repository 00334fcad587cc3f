"""Files that other programs read: glTF, point caches, meshes per frame, video. Arrays in, files out."""
