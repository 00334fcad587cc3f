"""What is written to disk, and nothing else. The only importer of zarr."""
