"""What a person points at becomes an object: clicks, strokes and mattes of one frame, carried to all frames through the scene."""
