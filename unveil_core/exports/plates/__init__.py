"""Clean plates for compositing and editing: PNG, OpenEXR, movies."""
